"""Check that the sensors' counter advances at the rate that the setting of their period implies.

Laws that look back convert sample numbers to times. Nothing else reveals a setting that differs
from the plant's period, because every frame is valid. So the advance of the counter is compared
with the clock, in windows of a second:

    counted = samples · sensor period           differs from the window's length by a fifth

The setting counts as wrong only after WINDOWS successive windows that differ in the same direction.
Jitter and a changing latency move the ends of a window and cancel in the next one. Loss does not
change the counter. A gap, as when the plant is stopped, ends its window. The same number of
windows that agree withdraws the verdict.
"""

from typing import NamedTuple

WINDOW_NS = 1_000_000_000
WINDOWS = 4
TOLERANCE = 1.2
"""In either direction; more than the effect of a latency that rises by half a second in WINDOWS."""
GAP_NS = 500_000_000
"""After this time without a sample the number of samples is unknown."""


class RateState(NamedTuple):
    """The open window, and the result of those before.

    ``begin_sample``, ``begin_ns``  its first sample, and when that arrived; -1 for no window
    ``side``, ``run``               of the last ``run`` windows: 1 too many samples, -1 too few
    ``is_wrong``                    whether the measured period differs from the setting
    ``times_wrong``                 how often this was detected
    ``measured_ns``                 the period in the last window that differed, 0 for none
    """

    begin_sample: int
    begin_ns: int
    side: int
    run: int
    is_wrong: bool
    times_wrong: int
    measured_ns: float


NO_RATE = RateState(0, -1, 0, 0, False, 0, 0.0)


def rate_step(
    period_ns: int, x: RateState, newest_ns: int, sample: int, arrival_ns: int
) -> RateState:
    """Process a sample; one no newer than the first of the window begins another.

    ``period_ns``  the setting
    ``newest_ns``  when the sample before it arrived, if there is one
    """
    begin_sample, begin_ns = x[0], x[1]
    if begin_ns < 0 or sample <= begin_sample or arrival_ns - newest_ns > GAP_NS:
        return RateState(sample, arrival_ns, *x[2:])
    lasted_ns = arrival_ns - begin_ns
    if lasted_ns < WINDOW_NS:
        return x
    samples = sample - begin_sample
    counted_ns = samples * period_ns
    side = 0
    if counted_ns > TOLERANCE * lasted_ns:
        side = 1
    elif lasted_ns > TOLERANCE * counted_ns:
        side = -1
    run = x.run + 1 if side == x.side else 1
    is_wrong = side != 0 if run >= WINDOWS else x.is_wrong
    times_wrong = x.times_wrong + 1 if is_wrong and not x.is_wrong else x.times_wrong
    measured_ns = lasted_ns / samples if side != 0 else x.measured_ns
    return RateState(sample, arrival_ns, side, run, is_wrong, times_wrong, measured_ns)
