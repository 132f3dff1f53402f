"""How latency changes over the time of motion: schedules and recorded traces.

A schedule is a list of points in time order. With shape `step` a point holds until the next one,
with `ramp` the values are interpolated. Two points at the same time make a step in a ramp schedule.
The first and the last point extend outwards.
"""

import csv
import math
from bisect import bisect_right
from collections.abc import Sequence
from enum import StrEnum
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

LATENCY_S_MAX = 10.0
"""Longest latency; it limits how many frames a latency line holds."""


class Shape(StrEnum):
    """Interpolation of a schedule."""

    STEP = "step"
    RAMP = "ramp"


class ProfilePoint(NamedTuple):
    """Latency from ``time_s`` of motion on."""

    time_s: float
    mean_s: float
    spread_s: float
    loss: float


def profile_at(points: Sequence[ProfilePoint], shape: Shape, time_s: float) -> ProfilePoint:
    """Return the values in force at ``time_s``; ``points`` are not empty and in time order."""
    after = bisect_right(points, time_s, key=lambda point: point.time_s)
    if after == 0:
        return points[0]
    before = points[after - 1]
    if after == len(points) or shape is Shape.STEP:
        return before
    share = (time_s - before.time_s) / (points[after].time_s - before.time_s)
    _, mean_s, spread_s, loss = (
        a + share * (b - a) for a, b in zip(before, points[after], strict=True)
    )
    return ProfilePoint(time_s, mean_s, spread_s, loss)


class Trace(NamedTuple):
    """Recorded latencies: one per frame, or, where ``times_s`` is not empty, over time."""

    latencies_s: tuple[float, ...]
    times_s: tuple[float, ...] = ()

    def latency_s(self, frame: int, time_s: float) -> float:
        """Return the latency of the ``frame``-th frame (from 0), sent at ``time_s`` of motion.

        A trace per frame repeats. In a trace over time a row holds until the time of the next one;
        the first and the last extend outwards.
        """
        if not self.times_s:
            return self.latencies_s[frame % len(self.latencies_s)]
        return self.latencies_s[max(bisect_right(self.times_s, time_s) - 1, 0)]


def read_trace(path: Path) -> Trace:
    """Read a CSV file whose first line is ``latency_s`` or ``time_s,latency_s``.

    Raises OSError if the file cannot be read, and ValueError with the line unless it has finite
    latencies ≥ 0 at rising times.
    """
    with path.open(newline="", encoding="utf-8") as file:
        rows = csv.reader(file)
        try:
            header = next(rows, [])
            if header not in (["latency_s"], ["time_s", "latency_s"]):
                raise ValueError(f"{path}, line 1: must be latency_s or time_s,latency_s")
            table = [_numbers(path, rows.line_num, row, header) for row in rows]
        except csv.Error as error:
            raise ValueError(f"{path}, line {rows.line_num}: {error}") from error
        except UnicodeDecodeError as error:
            raise ValueError(f"{path}: is not UTF-8 text (byte {error.start})") from error
    if not table:
        raise ValueError(f"{path}: holds no latencies")
    times_s = tuple(row[0] for row in table) if len(header) == 2 else ()
    for line, (earlier_s, later_s) in enumerate(pairwise(times_s), start=3):
        if later_s <= earlier_s:
            raise ValueError(
                f"{path}, line {line}: time_s must rise, {later_s} follows {earlier_s}"
            )
    return Trace(tuple(row[-1] for row in table), times_s)


def _numbers(path: Path, line: int, row: Sequence[str], header: Sequence[str]) -> list[float]:
    """Return one row of a trace; raises ValueError naming the line."""
    try:
        values = [float(cell) for cell in row]
    except ValueError:
        values = []
    if len(values) != len(header) or not all(0.0 <= value < math.inf for value in values):
        wanted = ",".join(header)
        raise ValueError(f"{path}, line {line}: needs {wanted}, each a finite number from 0 up")
    if values[-1] > LATENCY_S_MAX:
        raise ValueError(f"{path}, line {line}: allowed is a latency up to {LATENCY_S_MAX:g} s")
    return values
