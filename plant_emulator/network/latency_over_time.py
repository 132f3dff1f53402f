"""Latency over the time of motion: schedules and recorded traces.

A schedule is a list of points in time order. With shape `step` a point holds until the next one,
with `ramp` the values are interpolated. Two points at the same time make a step in a ramp schedule.
The first and the last point extend outwards.
"""

import math
from bisect import bisect_right
from collections.abc import Sequence
from enum import StrEnum
from itertools import pairwise
from operator import itemgetter
from pathlib import Path
from typing import NamedTuple

from ...runtime.settings import SettingsError
from ...runtime.settings.number_table import TableRow, convert_cells, read_number_table

LATENCY_S_MAX = 10.0
"""Longest latency; it limits how many frames a latency line holds."""
TIME_S_MAX = 1e6
"""No run is longer; times beyond it are those of a wall clock."""
_LOST = ("", "lost", "nan")


class Shape(StrEnum):
    """Interpolation of a schedule."""

    STEP = "step"
    RAMP = "ramp"


Values = tuple[float, float, float, float]
"""Time of motion, and from then on mean and standard deviation [s], and share of lost frames."""
Profile = Sequence[Values]


def profile_at(points: Profile, shape: Shape, time_s: float) -> Values:
    """Return the values in force at ``time_s``; ``points`` are not empty and in time order."""
    after = bisect_right(points, time_s, key=itemgetter(0))
    if after == 0:
        return points[0]
    before = points[after - 1]
    if after == len(points) or shape is Shape.STEP:
        return before
    share = (time_s - before[0]) / (points[after][0] - before[0])
    _, *values = (a + share * (b - a) for a, b in zip(before, points[after], strict=True))
    mean_s, spread_s, loss = values
    return time_s, mean_s, spread_s, loss


class Trace(NamedTuple):
    """Recorded latencies: one per sample, or, where ``times_s`` is not empty, over time.

    A latency that is not a number is that of frames that were lost.
    """

    latencies_s: tuple[float, ...]
    times_s: tuple[float, ...] = ()

    def latency_s(self, sample: int, time_s: float) -> float:
        """Return the latency of the frames of a ``sample`` (from 0), sent at ``time_s`` of motion.

        A trace per sample repeats. In a trace over time a row holds until the time of the next one;
        the first and the last extend outwards.
        """
        if not self.times_s:
            return self.latencies_s[sample % len(self.latencies_s)]
        return self.latencies_s[max(bisect_right(self.times_s, time_s) - 1, 0)]


def read_trace(path: Path) -> Trace:
    """Read a table with the column ``latency_s``, over ``time_s`` if it has that column too.

    An empty cell, ``lost`` or ``nan`` is a loss. Times of a wall clock count from the first row.

    Raises SettingsError with the line unless it has latencies of 0 to LATENCY_S_MAX at rising
    times.
    """
    names, rows = read_number_table(path, (("time_s", "latency_s"), ("latency_s",)))
    if not rows:
        raise SettingsError(f"{path}: holds no latencies")
    wanted = f"a latency from 0 to {LATENCY_S_MAX:g} s, or lost"
    latencies = [TableRow(row.line, row.cells[-1:]) for row in rows]
    latencies_s = tuple(value for (value,) in convert_cells(path, latencies, _latency, wanted))
    if len(names) == 1:
        return Trace(latencies_s)
    times = [TableRow(row.line, row.cells[:1]) for row in rows]
    times_s = [value for (value,) in convert_cells(path, times, _time, "a time_s from 0 up")]
    for row, (earlier_s, later_s) in zip(rows[1:], pairwise(times_s), strict=True):
        if later_s <= earlier_s:
            raise SettingsError(
                f"{path}, line {row.line}: time_s must rise, {later_s} follows {earlier_s}"
            )
    start_s = times_s[0] if times_s[0] > TIME_S_MAX else 0.0
    return Trace(latencies_s, tuple(time_s - start_s for time_s in times_s))


def _latency(cell: str) -> float:
    latency_s = math.nan if cell.lower() in _LOST else float(cell)
    if latency_s < 0.0 or latency_s > LATENCY_S_MAX:
        raise ValueError(cell)
    return latency_s


def _time(cell: str) -> float:
    if not 0.0 <= (time_s := float(cell)) < math.inf:
        raise ValueError(cell)
    return time_s
