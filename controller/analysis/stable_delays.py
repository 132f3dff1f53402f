"""The set of constant delays at which a loop is stable, up to a limit, as intervals.

The set need not be an interval that starts at zero: an observer can make a loop unstable at 80 ms
and stable at 160 ms. Stability is judged at every SCAN_STEP_NS. Where two neighbours differ, the
boundary between them is bisected to RESOLUTION_NS.

A loop of one rate is also judged between every two delays at which a mode crosses the stability
limit, so that no stretch is missed for being short, down to RESOLUTION_NS. Of a ``PeriodicLoop``, a
stretch that begins and ends between two steps is missed.

A loop of one rate is judged by the argument principle (``growing_modes``). It agrees with the
eigenvalues of ``SampledLoop``, but its cost does not grow with the number of commands in transit.
"""

from collections.abc import Callable, Iterable
from itertools import groupby, pairwise
from operator import itemgetter
from typing import NamedTuple

from .growing_modes import GrowingModes
from .periodic_loop import PeriodicLoop
from .sampled_loop import SampledLoop

SCAN_STEP_NS = 10_000_000
RESOLUTION_NS = 10_000
DELAY_NS_MAX = 600_000_000

Loop = SampledLoop | PeriodicLoop


class Interval(NamedTuple):
    """Delays from ``first_ns`` to ``last_ns`` [ns], both of them stable and all judged between.

    Stability ends less than RESOLUTION_NS beyond either end, but for 0 and the limit of the search.
    """

    first_ns: int
    last_ns: int


def stable_delays(loop: Loop, delay_ns_max: int = DELAY_NS_MAX) -> tuple[Interval, ...]:
    """Return the stable delays from 0 to a limit, ascending; empty if there are none."""
    tested_ns, is_stable = _scan(loop, delay_ns_max)
    return stable_intervals({each: is_stable(each) for each in tested_ns}, is_stable)


def _scan(loop: Loop, delay_ns_max: int) -> tuple[list[int], Callable[[int], bool]]:
    """Return the delays that are judged, ascending, and what judges them."""
    scan = [*range(0, delay_ns_max, SCAN_STEP_NS), delay_ns_max]
    if isinstance(loop, PeriodicLoop):
        # Just after a step, too: the measured delay may jump there.
        return sorted({*scan, *(delay_ns + 1 for delay_ns in scan[:-1])}), loop.is_stable
    modes = GrowingModes(loop, delay_ns_max)
    crossings = [0, *(round(delay_ns) for delay_ns in modes.crossings_ns()), delay_ns_max]
    between = {(a + b) // 2 for a, b in pairwise(crossings) if b - a > RESOLUTION_NS}
    return sorted({*scan, *between}), lambda delay_ns: modes.count(delay_ns) == 0


def stable_intervals(
    judged: dict[int, bool], is_stable: Callable[[int], bool], resolution_ns: int = RESOLUTION_NS
) -> tuple[Interval, ...]:
    """Return the stable stretches of delays [ns], from the verdicts on some of them.

    Between two with different verdicts the boundary is bisected; ``judged`` gets its two ends.
    """
    for (low_ns, was_stable), (high_ns, becomes_stable) in pairwise(sorted(judged.items())):
        if was_stable != becomes_stable:
            ends_ns = _boundary(low_ns, high_ns, was_stable, is_stable, resolution_ns)
            judged.update(zip(ends_ns, (was_stable, becomes_stable), strict=True))
    stretches = (
        [delay_ns for delay_ns, _ in group]
        for verdict, group in groupby(sorted(judged.items()), key=itemgetter(1))
        if verdict
    )
    return tuple(Interval(delays_ns[0], delays_ns[-1]) for delays_ns in stretches)


def _boundary(
    low_ns: int, high_ns: int, was_stable: bool, is_stable: Callable[[int], bool], within_ns: int
) -> tuple[int, int]:
    """Return two delays with different verdicts, at most so far apart."""
    while high_ns - low_ns > within_ns:
        middle_ns = (low_ns + high_ns) // 2
        if is_stable(middle_ns) == was_stable:
            low_ns = middle_ns
        else:
            high_ns = middle_ns
    return low_ns, high_ns


def delay_margin_ns(
    intervals: tuple[Interval, ...], delay_ns_max: int = DELAY_NS_MAX
) -> int | None:
    """Return the delay at which stability is first lost, coming from zero [ns].

    0 if the loop is not even stable without delay, None if it is up to the limit of the search.
    """
    if not intervals or intervals[0].first_ns > 0:
        return 0
    return None if intervals[0].last_ns >= delay_ns_max else intervals[0].last_ns


def least_margin_ns(loops: Iterable[Loop], delay_ns_max: int = DELAY_NS_MAX) -> int:
    """Return the delay up to which every loop is stable [ns], at most the limit of the search.

    It is the least ``delay_margin_ns``; what lies beyond is not judged.
    """
    margin_ns = delay_ns_max
    for loop in loops:
        tested_ns, is_stable = _scan(loop, delay_ns_max)
        stable_ns = 0
        for delay_ns in tested_ns:
            if not is_stable(delay_ns):
                end_ns, _ = _boundary(stable_ns, delay_ns, True, is_stable, RESOLUTION_NS)
                margin_ns = min(margin_ns, end_ns)
                break
            if delay_ns >= margin_ns:
                break
            stable_ns = delay_ns
    return margin_ns
