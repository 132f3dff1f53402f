"""The values of one quantity over the last SPAN_S, and what a view shows of them.

How late the commands of the last SPAN_S were, from their numbers and arrivals.

Commands are numbered, and due at a fixed period: the median of those between commands that are half
the span apart, so that a burst of late ones does not count. A straight line of this period through
the earliest command gives the times they were due.
"""

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from ...dbc.messages import COMMAND_COUNTERS
from ...runtime.array_types import FloatArray, IntArray
from ...runtime.node import NS_PER_S

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


JUMP_MAX = 4096
"""A counter that jumps further is that of a controller that was restarted."""
_REFIT_NS = NS_PER_S
_COMMANDS_MIN = 3
_RECENT_NS = 2 * NS_PER_S
"""A controller that has skipped periods is on time again, by other numbers, after so long."""


class _Due(NamedTuple):
    """When a command was due: ``start_s`` after the first of the fit, and ``period_s`` a number."""

    first_ns: int
    first: int
    start_s: float
    period_s: float


class CommandLateness:
    """Takes the counter of every command and when it arrived."""

    def __init__(self) -> None:
        self._commands: deque[tuple[int, int]] = deque(maxlen=POINTS_MAX)  # time, number
        self._due: _Due | None = None
        self._fit_ns = 0

    def take(self, counter: int, now_ns: int) -> None:
        """Take a command that arrived at ``now_ns``."""
        number = self._commands[-1][1] if self._commands else counter
        step = (counter - number) % COMMAND_COUNTERS
        if step > JUMP_MAX:
            self._commands.clear()
            self._fit_ns = 0
            number, step = counter, 0
        self._commands.append((now_ns, number + step))
        while now_ns - self._commands[0][0] > SPAN_NS:
            self._commands.popleft()

    def newest_s(self) -> float:
        """Return how late the newest command was [s], against the earliest of two seconds or so.

        NaN without three commands.
        """
        if not self._commands:
            return math.nan
        now_ns, number = self._commands[-1]
        if self._due is None or now_ns >= self._fit_ns:
            known_ns = now_ns - self._commands[0][0]
            fit = self._fitted(now_ns - _RECENT_NS)
            self._due, self._fit_ns = fit, now_ns + min(known_ns // 4, _REFIT_NS)
        due = self._due
        if due is None:
            return math.nan
        since_s = (now_ns - due.first_ns) / NS_PER_S
        return max(since_s - due.start_s - due.period_s * (number - due.first), 0.0)

    def arrays(self, now_ns: int) -> tuple[IntArray, FloatArray]:
        """Return age [ns] and lateness [s] of the last commands, each of shape (n,)."""
        due = self._fitted(now_ns - SPAN_NS)
        if due is None:
            return np.empty(0, dtype=np.int64), np.empty(0)
        times_ns, numbers = np.array(self._commands, dtype=np.int64).T
        elapsed_s = (times_ns - due.first_ns) / NS_PER_S
        return now_ns - times_ns, elapsed_s - due.start_s - due.period_s * (numbers - due.first)

    def _fitted(self, since_ns: int) -> _Due | None:
        """Return the line through the earliest command since then; None without enough of them."""
        if len(self._commands) < _COMMANDS_MIN:
            return None
        times_ns, numbers = np.array(self._commands, dtype=np.int64).T
        elapsed_s = (times_ns - times_ns[0]) / NS_PER_S
        count = (numbers - numbers[0]).astype(np.float64)
        half = len(count) // 2
        steps = count[half:] - count[:-half]
        if not steps.all():
            return None
        period_s = float(np.median((elapsed_s[half:] - elapsed_s[:-half]) / steps))
        is_recent = times_ns >= min(since_ns, times_ns[-1])
        start_s = float((elapsed_s - period_s * count)[is_recent].min())
        return _Due(int(times_ns[0]), int(numbers[0]), start_s, period_s)
