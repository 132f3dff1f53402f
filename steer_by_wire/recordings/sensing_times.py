"""When the plant sensed, up to a constant: from the numbers of its samples and their arrivals.

    s_k = s_0 + k T + (samples skipped before k) T

A stalled plant skips samples without counting them, which moves s_k by whole periods. It sends
nothing meanwhile, so a skip of n samples comes with a silence of n periods or more. After such a
silence the arrivals are later than before it by n T; n is the nearest whole number that the silence
allows, if it stands out from the jitter.
"""

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..dbc.messages import CYCLE_TIMES_MS, SteeringStatus
from ..runtime.array_types import FloatArray
from ..runtime.node import NS_PER_MS, NS_PER_S

NumberArray = NDArray[Any]
"""Whole numbers or nanoseconds, as integers or floats."""
NEIGHBOURS_MAX, NEIGHBOURS_MIN = 50, 10
"""Samples compared on each side of a silence: up to the next silence, within these two bounds."""
_BEHIND_MIN = 3
"""Samples that are enough where a log ends."""
SIGNIFICANT = 7.0
"""A shift of more than this many standard errors is significant."""
_JUMP_NS = NS_PER_S // 2
"""A larger shift of the sensing times is no latency: the plant was restarted."""


class Uplink(NamedTuple):
    """How much later than the fastest each sample came.

    ``latency_ns``  shape (n,) [ns], the smallest is 0
    ``skipped``     samples that the plant seems to have skipped
    """

    latency_ns: FloatArray
    skipped: int


def relative_uplink(
    numbers: NumberArray, arrivals_ns: NumberArray, silences_ns: NumberArray
) -> Uplink:
    """Return the uplink latency of samples, up to that of the fastest.

    Each argument has shape (n,), n at least 2, in order of arrival.

    ``numbers``      of the samples, as counted by the plant
    ``silences_ns``  how long the plant was silent, at most, since the sample before [ns]
    """
    period_ns = _period_ns(numbers, arrivals_ns)
    shift_ns = arrivals_ns - arrivals_ns[0] - (numbers - numbers[0]) * period_ns
    skipped = 0
    # A restarted plant begins with any number, at any time.
    jumps = np.flatnonzero(np.abs(np.diff(shift_ns)) > _JUMP_NS) + 1
    edges = [0, *jumps.tolist(), len(shift_ns)]
    for start, end in pairwise(edges):
        part_ns, its_skipped = _without_skips(
            shift_ns[start:end], silences_ns[start:end], period_ns
        )
        shift_ns[start:end] = part_ns - part_ns.min()
        skipped += its_skipped
    return Uplink(np.asarray(shift_ns, dtype=np.float64), skipped)


def _without_skips(
    shift_ns: NumberArray, silences_ns: NumberArray, period_ns: float
) -> tuple[FloatArray, int]:
    """Return the shifts without those of skipped samples, and how many samples those are."""
    corrected_ns = np.array(shift_ns, dtype=np.float64)
    # A sample that came on time follows a silence of one period: nothing was skipped.
    silent = np.flatnonzero(silences_ns >= 1.1 * period_ns).tolist()
    skipped = 0
    for place, next_place in zip(silent, [*silent[1:], len(shift_ns)], strict=False):
        far = max(min(next_place, place + NEIGHBOURS_MAX), place + NEIGHBOURS_MIN)
        before_ns = corrected_ns[max(place - NEIGHBOURS_MAX, 0) : place]
        behind_ns = corrected_ns[place:far]
        if not (before_ns.size and behind_ns.size >= _BEHIND_MIN):
            continue
        later_ns = float(np.median(behind_ns) - np.median(before_ns))
        count = min(round(later_ns / period_ns), int(silences_ns[place] // period_ns))
        if count > 0 and later_ns > SIGNIFICANT * _standard_error_ns(before_ns, behind_ns):
            corrected_ns[place:] -= count * period_ns
            skipped += count
    return corrected_ns, skipped


def _standard_error_ns(before_ns: FloatArray, behind_ns: FloatArray) -> float:
    """Return the standard error of the medians' difference, from both sides' median deviation."""
    deviations_ns = np.concatenate([part - np.median(part) for part in (before_ns, behind_ns)])
    deviation_ns = 1.4826 * float(np.median(np.abs(deviations_ns)))
    return 1.2533 * deviation_ns * float(np.sqrt(1.0 / before_ns.size + 1.0 / behind_ns.size))


def _period_ns(numbers: NumberArray, arrivals_ns: NumberArray) -> float:
    """Return the sensing period [ns]: the DBC's, unless the log shows another one."""
    wanted_ns = float(CYCLE_TIMES_MS[SteeringStatus] * NS_PER_MS)
    steps = np.diff(numbers)
    is_forward = steps > 0
    if not is_forward.any():
        return wanted_ns
    measured_ns = float(np.median(np.diff(arrivals_ns)[is_forward] / steps[is_forward]))
    overall_ns = float(arrivals_ns[-1] - arrivals_ns[0]) / max(float(numbers[-1] - numbers[0]), 1.0)
    if any(abs(period_ns / wanted_ns - 1.0) < 0.05 for period_ns in (measured_ns, overall_ns)):
        return wanted_ns
    return round(measured_ns, -3)
