"""Whether the sensors' counter advances as fast as the setting of their period says.

Laws that look back take the numbers of samples for times. A setting that is not the plant's shows
in nothing else: every frame is in order. So the samples that a counter has advanced by are held
against the clock, in windows of a second:

    counted = samples · sensor period           differs from the window's length by a fifth

Only when WINDOWS in a row are off to the same side, the setting is wrong: jitter and a latency that
changes move the ends of windows and cancel in the next one, loss changes no counter, and a gap, as
of a plant that was stopped, ends the window that it is in. As many that agree take it back.
"""

from typing import NamedTuple

WINDOW_NS = 1_000_000_000
WINDOWS = 4
TOLERANCE = 1.2
"""To either side; more than a latency does that rises by half a second in as few windows."""
GAP_NS = 500_000_000
"""Without a sample for so long nothing is known of how many there were."""


class RateState(NamedTuple):
    """The window that is open, and what those before have shown.

    ``begin_sample``, ``begin_ns``  its first sample, and when that arrived; -1 for no window
    ``side``, ``run``               of the last ``run`` windows: 1 too many samples, -1 too few
    ``is_wrong``                    whether the period is not the setting's
    ``times_wrong``                 how often it was found to be another
    ``measured_ns``                 the period in the last window that was off, 0 for none
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
    """Take a sample later than any before.

    ``period_ns``  the setting
    ``newest_ns``  when the sample before it arrived, if there is one
    """
    if x.begin_ns < 0 or arrival_ns - newest_ns > GAP_NS:
        return RateState(
            sample, arrival_ns, x.side, x.run, x.is_wrong, x.times_wrong, x.measured_ns
        )
    lasted_ns = arrival_ns - x.begin_ns
    if lasted_ns < WINDOW_NS:
        return x
    samples = sample - x.begin_sample
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
