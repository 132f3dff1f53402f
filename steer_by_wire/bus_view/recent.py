"""The values of one quantity over the last SPAN_S, and what a view shows of them."""

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from ..runtime.array_types import FloatArray, IntArray
from ..runtime.node import NS_PER_S

SPAN_S = 15.0
POINTS_MAX = 1 << 14
"""Points of one quantity that are kept: SPAN_S at 1 kHz."""
STRIP_LENGTH = 120
"""Values of a strip: as many as a wide terminal has room for."""
SPAN_NS = round(SPAN_S * NS_PER_S)

Strip = tuple[float | None, ...]
"""The largest value of each of STRIP_LENGTH equal parts of SPAN_S, oldest first; None for none."""


class Spread(NamedTuple):
    """Median, 99th percentile and maximum of the last SPAN_S [s]."""

    p50_s: float
    p99_s: float
    max_s: float


class Recent:
    """Points of the last SPAN_S."""

    def __init__(self) -> None:
        self._points: deque[tuple[int, float]] = deque(maxlen=POINTS_MAX)

    def add(self, time_ns: int, value: float) -> None:
        """Append a value; times must not fall."""
        self._points.append((time_ns, value))
        while time_ns - self._points[0][0] > SPAN_NS:
            self._points.popleft()

    @property
    def newest(self) -> float:
        """The newest value; NaN before the first."""
        return self._points[-1][1] if self._points else math.nan

    def arrays(self, now_ns: int) -> tuple[IntArray, FloatArray]:
        """Return times before now [ns] and values, each of shape (n,)."""
        if not self._points:
            return np.empty(0, dtype=np.int64), np.empty(0)
        times, values = zip(*self._points, strict=True)
        return now_ns - np.array(times, dtype=np.int64), np.array(values)

    def strip(self, now_ns: int) -> Strip:
        """Return the values as a strip."""
        return strip_of(*self.arrays(now_ns))

    def spread(self, now_ns: int) -> Spread | None:
        """Return the spread of the values [s]; None without any."""
        return spread_of(self.arrays(now_ns)[1])


def strip_of(ages_ns: IntArray, values: FloatArray) -> Strip:
    """Return the strip of ``values`` that are ``ages_ns`` old [ns], both of shape (n,)."""
    strip: list[float | None] = [None] * STRIP_LENGTH
    places = STRIP_LENGTH - 1 - ages_ns * STRIP_LENGTH // SPAN_NS
    for place, value in zip(places.tolist(), values.tolist(), strict=True):
        if 0 <= place < STRIP_LENGTH:
            there = strip[place]
            if there is None or abs(value) > abs(there):
                strip[place] = value
    return tuple(strip)


def spread_of(values_s: FloatArray) -> Spread | None:
    """Return the spread of values of shape (n,) [s]; None without any."""
    if not values_s.size:
        return None
    p50_s, p99_s = np.quantile(values_s, (0.5, 0.99))
    return Spread(float(p50_s), float(p99_s), float(values_s.max()))
