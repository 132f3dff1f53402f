"""A steer that fades where it would jump, because what it was made from has gone stale or is back.

On either change the difference to the steer before is added, and is taken off step by step.
"""

from typing import NamedTuple

from .limits import ramp_step


class Fading(NamedTuple):
    """The steer given last, whether what it is made from was stale, and what is left to fade."""

    steer_rad: float
    is_stale: bool
    fade_rad: float


NO_STEER = Fading(0.0, False, 0.0)


def fading_step(step_rad: float, x: Fading, wanted_rad: float, is_stale: bool) -> Fading:
    """Advance one period towards ``wanted_rad``; at most ``step_rad`` of a difference fades."""
    fade_rad = ramp_step(step_rad, x.fade_rad)
    if is_stale != x.is_stale:
        fade_rad = x.steer_rad - wanted_rad
    return Fading(wanted_rad + fade_rad, is_stale, fade_rad)
