"""A value that fades instead of jumping when it comes from another of two sources.

At a change the difference to the previous value is added, and then reduced step by step.
"""

from typing import NamedTuple

from ...runtime.record import new_record
from .steer_limits import ramp_step


class Fading(NamedTuple):
    """The last value, which of the sources it came from, and the difference still to fade."""

    value: float
    source: bool
    difference: float


NOTHING = Fading(0.0, False, 0.0)


def fading_step(step: float, x: Fading, wanted: float, source: bool) -> Fading:
    """Advance one period towards ``wanted``; at most ``step`` of a difference fades."""
    difference = ramp_step(step, x.difference)
    if source != x.source:
        difference = x.value - wanted
    return new_record(Fading, (wanted + difference, source, difference))
