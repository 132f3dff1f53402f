"""Times at which the plant sensed, found from the numbers of its samples and their arrivals.

    s_k = s_0 + k T + (samples skipped before k) T

T is fitted by least squares to all samples. It is taken as the roundest number that the fit allows,
because a period is set in milliseconds.

A stalled plant skips samples without counting them, which moves s_k by whole periods. It sends
nothing meanwhile, so a skip of n samples comes with a silence of n periods or more. After such a
silence the arrivals are later than before it by n T; n is the nearest whole number that the silence
allows, if it stands out from the jitter.
"""

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...dbc.messages import CYCLE_TIMES_MS, SteeringStatus
from ...runtime.array_types import FloatArray
from ...runtime.node import NS_PER_MS, NS_PER_S

NumberArray = NDArray[Any]
"""Whole numbers or nanoseconds, as integers or floats."""
NEIGHBOURS_MAX, NEIGHBOURS_MIN = 50, 10
"""Samples compared on each side of a silence: up to the next silence, within these two bounds."""
_BEHIND_MIN = 3
"""Samples that are enough where a log ends."""
SIGNIFICANT = 7.0
"""A shift of more than this many standard errors is significant."""
_JUMP_NS = NS_PER_S // 2
"""A larger shift of the sensing times may be a plant that was restarted."""
_LASTING = 20
"""Samples behind a jump that make it one: fewer are frames that came late."""
_APART_MAX = 256
"""Samples between the two of a first slope, an eighth of all at most."""
_ROUND_NS = (1e6, 1e5, 1e4, 1e3)
_ROUND_ERRORS = 3.0
"""A round period is taken within this many standard errors."""


class Uplink(NamedTuple):
    """How much later than the fastest sample each one came.

    ``latency_ns``  shape (n,) [ns], the smallest of each part is 0
    ``skipped``     samples that the plant seems to have skipped
    ``error_ns``    standard error of the period
    ``edges``       first samples of the parts, and the end; each part has its own fastest sample
    """

    latency_ns: FloatArray
    skipped: int
    period_ns: float
    error_ns: float
    edges: list[int]


def relative_uplink(
    numbers: NumberArray, arrivals_ns: NumberArray, silences_ns: NumberArray
) -> Uplink:
    """Return the uplink latency of samples, less that of the fastest of its part.

    Each argument has shape (n,), n at least 2, in order of arrival.

    ``numbers``      of the samples, as counted by the plant
    ``silences_ns``  how long the plant was silent, at most, since the sample before [ns]
    """
    since = numbers - numbers[0]
    arrived_ns = np.asarray(arrivals_ns - arrivals_ns[0], dtype=np.float64)
    period_ns, error_ns = _first_period_ns(since, arrived_ns), 0.0
    # The skips need a period, and the period needs times without skips.
    for _ in range(3):
        shift_ns = arrived_ns - since * period_ns
        # A restarted plant begins with any number, at any time.
        jumps = np.flatnonzero(np.abs(np.diff(shift_ns)) > _JUMP_NS) + 1
        edges = [0, *jumps.tolist(), len(shift_ns)]
        skipped = 0
        for start, end in pairwise(edges):
            part_ns, its_skipped = _without_skips(
                shift_ns[start:end], silences_ns[start:end], period_ns
            )
            shift_ns[start:end] = part_ns
            skipped += its_skipped
        slope_ns, error_ns = _slope(since, shift_ns, edges)
        fitted_ns = _rounded(period_ns + slope_ns, error_ns)
        if fitted_ns == period_ns or fitted_ns <= 0.0:  # by a clock that stands still
            break
        period_ns = fitted_ns
    lasting = [start for start, end in pairwise(edges) if not start or end - start >= _LASTING]
    parts = [*lasting, edges[-1]]
    for start, end in pairwise(parts):
        shift_ns[start:end] -= shift_ns[start:end].min()
    return Uplink(shift_ns, skipped, period_ns, error_ns, parts)


def _first_period_ns(since: NumberArray, arrived_ns: FloatArray) -> float:
    """Return about the period [ns]: the median slope between samples that are far apart."""
    apart = max(min(len(since) // 16, _APART_MAX), 1)
    steps = since[apart:] - since[:-apart]
    is_forward = steps > 0
    slopes_ns = (arrived_ns[apart:] - arrived_ns[:-apart])[is_forward] / steps[is_forward]
    median_ns = float(np.median(slopes_ns)) if is_forward.any() else 0.0
    dbc_ns = float(CYCLE_TIMES_MS[SteeringStatus] * NS_PER_MS)
    is_dbcs = abs(median_ns / dbc_ns - 1.0) < 0.05
    return dbc_ns if is_dbcs or median_ns <= 0.0 else median_ns  # a clock that stands still


def _slope(since: NumberArray, shift_ns: FloatArray, edges: list[int]) -> tuple[float, float]:
    """Return the slope of the shifts, with an intercept for each part, and its error [ns]."""
    numbers, left_ns = np.array(since, dtype=np.float64), shift_ns.copy()
    for start, end in pairwise(edges):
        numbers[start:end] -= numbers[start:end].mean()
        left_ns[start:end] -= left_ns[start:end].mean()
    spread = float(numbers @ numbers)
    if not spread:
        return 0.0, np.inf
    slope_ns = float(numbers @ left_ns) / spread
    left_ns -= slope_ns * numbers
    squares = float(left_ns @ left_ns)
    # Latencies that follow one another closely tell less than independent ones.
    kept = float(left_ns[1:] @ left_ns[:-1]) / squares if squares else 0.0
    alike = (1.0 + kept) / (1.0 - kept) if 0.0 < kept < 1.0 else 1.0
    freedom = max(len(left_ns) - len(edges), 1)
    return slope_ns, float(np.sqrt(alike * squares / freedom / spread))


def _rounded(period_ns: float, error_ns: float) -> float:
    """Return the roundest period that the fit allows."""
    for unit_ns in _ROUND_NS:
        rounded_ns = round(period_ns / unit_ns) * unit_ns
        if rounded_ns > 0.0 and abs(rounded_ns - period_ns) <= _ROUND_ERRORS * error_ns:
            return rounded_ns
    return period_ns


def _without_skips(
    shift_ns: NumberArray, silences_ns: NumberArray, period_ns: float
) -> tuple[FloatArray, int]:
    """Return the shifts without those of skipped samples, and how many samples those are."""
    corrected_ns = np.array(shift_ns, dtype=np.float64)
    # A sample that came on time follows a silence of one period: nothing was skipped.
    silent = np.flatnonzero(silences_ns >= 1.1 * period_ns).tolist()
    least_ns, skipped = _standard_error_of_level_ns(corrected_ns), 0
    for place, next_place in zip(silent, [*silent[1:], len(shift_ns)], strict=False):
        far = max(min(next_place, place + NEIGHBOURS_MAX), place + NEIGHBOURS_MIN)
        before_ns = corrected_ns[max(place - NEIGHBOURS_MAX, 0) : place]
        behind_ns = corrected_ns[place:far]
        if not (before_ns.size and behind_ns.size >= _BEHIND_MIN):
            continue
        later_ns = float(np.median(behind_ns) - np.median(before_ns))
        count = min(round(later_ns / period_ns), int(silences_ns[place] // period_ns))
        if count <= 0:
            continue
        error_ns = max(_standard_error_ns(before_ns, behind_ns), least_ns)
        if later_ns > SIGNIFICANT * error_ns:
            corrected_ns[place:] -= count * period_ns
            skipped += count
    return corrected_ns, skipped


def _standard_error_ns(before_ns: FloatArray, behind_ns: FloatArray) -> float:
    """Return the standard error of the medians' difference, from both sides' median deviation."""
    deviations_ns = np.concatenate([part - np.median(part) for part in (before_ns, behind_ns)])
    deviation_ns = 1.4826 * float(np.median(np.abs(deviations_ns)))
    return 1.2533 * deviation_ns * float(np.sqrt(1.0 / before_ns.size + 1.0 / behind_ns.size))


def _standard_error_of_level_ns(shift_ns: FloatArray) -> float:
    """Return what a change of level is at least uncertain by: latencies may wander.

    It is the median change from one NEIGHBOURS_MIN samples to the next; 0 where they are too few.
    """
    count = len(shift_ns) // NEIGHBOURS_MIN
    if count < NEIGHBOURS_MIN // 2:
        return 0.0
    levels_ns = np.median(shift_ns[: count * NEIGHBOURS_MIN].reshape(count, -1), axis=1)
    return 1.4826 * float(np.median(np.abs(np.diff(levels_ns))))
