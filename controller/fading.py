"""A value that fades instead of jumping when its input becomes stale or comes back.

On either change the difference to the previous value is added, and then reduced step by step.
"""

from typing import NamedTuple

from .limits import ramp_step


class Fading(NamedTuple):
    """The last value, whether its input was stale, and the difference still to fade."""

    value: float
    is_stale: bool
    difference: float


NOTHING = Fading(0.0, False, 0.0)


def fading_step(step: float, x: Fading, wanted: float, is_stale: bool) -> Fading:
    """Advance one period towards ``wanted``; at most ``step`` of a difference fades."""
    difference = ramp_step(step, x.difference)
    if is_stale != x.is_stale:
        difference = x.value - wanted
    return Fading(wanted + difference, is_stale, difference)
