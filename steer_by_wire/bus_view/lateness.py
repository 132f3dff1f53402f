"""How late the commands of the last SPAN_S were, from their numbers and arrivals.

Commands are numbered, and due at a fixed period: the median of those between commands that are half
the span apart, so that a burst of late ones does not count. A straight line of this period through
the earliest command gives the times they were due.
"""

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from ..dbc.messages import COMMAND_COUNTERS
from ..runtime.array_types import FloatArray, IntArray
from ..runtime.node import NS_PER_S
from .recent import POINTS_MAX, SPAN_NS

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
