"""A steer that fades instead of jumping when its input becomes stale or comes back.

On either change the difference to the previous steer is added, and then reduced step by step.
"""

from typing import NamedTuple

from .limits import ramp_step


class Fading(NamedTuple):
    """The last steer, whether its input was stale, and the difference still to fade."""

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
