"""The set of constant delays at which the sampled loop is stable, up to a limit, as intervals.

The set need not be an interval that starts at zero: an observer can make a loop unstable at 80 ms
and stable at 160 ms. Stability is judged

- at every SCAN_STEP_NS,
- between every two neighbouring delays at which a mode crosses the stability limit,

so that neither a stable nor an unstable stretch is missed for being short, down to RESOLUTION_NS.
Between two delays of different verdict the boundary is bisected to RESOLUTION_NS. The judge is the
argument principle (``growing_modes``), which agrees with the eigenvalues of ``SampledLoop`` but
does not grow with the commands on their way.
"""

from collections.abc import Mapping
from itertools import pairwise
from typing import NamedTuple

from .growing_modes import GrowingModes
from .sampled_loop import SampledLoop

SCAN_STEP_NS = 10_000_000
RESOLUTION_NS = 10_000
DELAY_NS_MAX = 600_000_000


class DelayInterval(NamedTuple):
    """Delays from ``first_ns`` to ``last_ns`` [ns], both of them stable and all between.

    Stability ends less than RESOLUTION_NS beyond either end, but for 0 and the limit of the search.
    """

    first_ns: int
    last_ns: int


def stable_delays(loop: SampledLoop, delay_ns_max: int = DELAY_NS_MAX) -> tuple[DelayInterval, ...]:
    """Return the stable delays from 0 to a limit, ascending; empty if there are none."""
    modes = GrowingModes(loop, delay_ns_max)
    judged = {
        delay_ns: modes.count(delay_ns) == 0 for delay_ns in _test_delays(modes, delay_ns_max)
    }
    for (before_ns, was_stable), (after_ns, is_stable) in pairwise(sorted(judged.items())):
        if was_stable != is_stable:
            judged.update(_bisected(modes, before_ns, after_ns, was_stable))
    return stable_intervals(judged)


def stable_intervals(judged: Mapping[int, bool]) -> tuple[DelayInterval, ...]:
    """Return the stable stretches of delays [ns] that were judged."""
    intervals: list[DelayInterval] = []
    was_stable = False
    for delay_ns, is_stable in sorted(judged.items()):
        if is_stable and was_stable:
            intervals[-1] = intervals[-1]._replace(last_ns=delay_ns)
        elif is_stable:
            intervals.append(DelayInterval(delay_ns, delay_ns))
        was_stable = is_stable
    return tuple(intervals)


def delay_margin_ns(
    intervals: tuple[DelayInterval, ...], delay_ns_max: int = DELAY_NS_MAX
) -> int | None:
    """Return the delay at which stability is first lost, coming from zero [ns].

    0 if the loop is not even stable without delay, None if it is up to the limit of the search.
    """
    if not intervals or intervals[0].first_ns > 0:
        return 0
    return None if intervals[0].last_ns >= delay_ns_max else intervals[0].last_ns


def _test_delays(modes: GrowingModes, delay_ns_max: int) -> list[int]:
    """Return the delays to judge: a scan, and one between every two crossings."""
    scan = {*range(0, delay_ns_max, SCAN_STEP_NS), delay_ns_max}
    crossings = [0, *(round(delay_ns) for delay_ns in modes.crossings_ns()), delay_ns_max]
    between = {(a + b) // 2 for a, b in pairwise(crossings) if b - a > RESOLUTION_NS}
    return sorted(scan | between)


def _bisected(
    modes: GrowingModes, before_ns: int, after_ns: int, stable_before: bool
) -> dict[int, bool]:
    """Return the two delays on either side of a boundary, RESOLUTION_NS apart at most."""
    while after_ns - before_ns > RESOLUTION_NS:
        middle_ns = (before_ns + after_ns) // 2
        if (modes.count(middle_ns) == 0) == stable_before:
            before_ns = middle_ns
        else:
            after_ns = middle_ns
    return {before_ns: stable_before, after_ns: not stable_before}
