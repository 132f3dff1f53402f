"""Fades: a command, or a part of one, continues without a jump when its source changes.

At the change the whole difference to the last value is added to the new source's. From then on the
difference moves towards zero by at most a step in each period. These fade:

    at supervision.ramp_rad_s   the law's command after a hold (``controller.node.law_runner``)
    at FADE_RAD_S               from one law to its fallback, and from one set of gains to another;
                                steer that a law derives from a VEHICLE_STATE that is now stale
    at FADE_M_S                 a set point derived from such a VEHICLE_STATE

The ramp of SAFE_STOP moves the last command to zero by the same step, ``ramp_step``.
"""

from typing import NamedTuple

from ...runtime.fast_named_tuple import new_record

FADE_RAD_S = 0.2
FADE_M_S = 0.1


class Fading(NamedTuple):
    """The last value, which of two sources it came from, and the difference still to fade."""

    value: float
    source: bool
    difference: float


NOTHING = Fading(0.0, False, 0.0)


def fading_step(step: float, x: Fading, wanted: float, source: bool) -> Fading:
    """Advance one period towards ``wanted``; at most ``step`` of a difference fades."""
    last, source_before, difference = x
    difference = difference_step(step, difference, last, wanted, source != source_before)
    return new_record(Fading, (wanted + difference, source, difference))


def difference_step(
    step: float, difference: float, last: float, wanted: float, is_new_source: bool
) -> float:
    """Return what to add to ``wanted`` in this period.

    ``difference``  what was added in the period before
    ``last``        the value of the period before
    """
    if is_new_source:
        return last - wanted
    return ramp_step(step, difference) if difference != 0.0 else 0.0


def ramp_step(step: float, value: float) -> float:
    """Move a value towards zero by at most ``step``, and never across it."""
    if value > step:
        return value - step
    if value < -step:
        return value + step
    return 0.0
