"""Frames as a program reads them from a live bus, and how late it reads them.

Where a port does not know when a frame has arrived, a program that has fallen behind would not see
it: it reads a second of frames within a millisecond, and 80 ms of latency look like one. So before
a reader waits it asks whether the queue is empty. A frame can have come since then, but not before.
"""

import time
from collections.abc import Callable
from typing import NamedTuple

from ...runtime.frame import Frame
from ...runtime.node import NS_PER_MS, NS_PER_S
from ...runtime.node.real_time_loop import Port

LATE_NS = 50 * NS_PER_MS
"""A program that reads a frame so long after it may have come has fallen behind."""
TIMED_NS = 10 * NS_PER_MS
"""A frame that may have waited longer than that has no time."""
_WAIT_NS_MAX = TIMED_NS // 2
"""A longer wait would not tell a frame that has just come from one that has waited."""


class LiveFrame(NamedTuple):
    """A frame.

    ``time_ns``   when it has arrived, or was read where that is not known
    ``late_ns``   how long it has waited, at most
    ``has_time``  whether ``time_ns`` is its arrival, to TIMED_NS
    """

    frame: Frame
    time_ns: int
    late_ns: int
    has_time: bool


class LiveReader:
    """Reads from ``port``."""

    def __init__(self, port: Port, clock_ns: Callable[[], int] = time.monotonic_ns) -> None:
        self._port = port
        self._clock_ns = clock_ns
        self._empty_ns = clock_ns()

    def next(self, until_ns: int) -> LiveFrame | None:
        """Return the next frame; None when none has come by ``until_ns``, or for a moment."""
        received = self._port.recv(0.0)
        if received is None:
            self._empty_ns = self._clock_ns()
            wait_ns = min(until_ns - self._empty_ns, _WAIT_NS_MAX)
            received = self._port.recv(max(wait_ns, 0) / NS_PER_S)
        now_ns = self._clock_ns()
        if received is None:
            self._empty_ns = now_ns
            return None
        frame, arrival_ns = received
        if arrival_ns is not None:
            time_ns = min(arrival_ns, now_ns)
            return LiveFrame(frame, time_ns, now_ns - time_ns, True)
        late_ns = now_ns - self._empty_ns
        return LiveFrame(frame, now_ns, late_ns, late_ns <= TIMED_NS)
