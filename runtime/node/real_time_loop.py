"""Run of one node in real time: waits for a frame or the node's deadline, whichever comes first.

A wake-up, in this order:

1. Read the clock. This reading is the time of all that follows.
2. Pass all waiting frames to the node, oldest first, but at most FRAMES_PER_WAKE_UP_MAX, so that a
   flood cannot keep the node from ticking. The others wait for the next wake-up, which follows at
   once. Error frames are not passed on.
   A frame comes with its arrival time if the port knows it, limited to between the last reading and
   this one: times passed to a node are never in the future, and never decrease.
   If a frame may have arrived since the reading, the clock is read again, so that no frame arrives
   before it was sent, however late the machine is.
3. Tick while the node's deadline is due.

Deadlines are absolute, so that one late tick makes no later tick late.
"""

import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

from ..frame import ERROR, Frame
from .node import NS_PER_S, Node
from .statistics import DurationStatistics

FRAMES_PER_WAKE_UP_MAX = 256
TICKS_PER_WAKE_UP_MAX = 10_000
"""Ticks at one reading of the clock before the node counts as stuck. Without this limit such a node
could not even be interrupted, because signals only request the end of the run."""
WAIT_NS_MAX = 50_000_000
"""Longest wait, so that a request to stop is noticed."""


def unobserved(_now_ns: int) -> None:
    """Observe nothing."""


class Received(NamedTuple):
    """A frame, and when it arrived on the monotonic clock [ns]; None where that is unknown."""

    frame: Frame
    arrival_ns: int | None


class Port(Protocol):
    """Where a node sends and receives."""

    def recv(self, timeout_s: float) -> Received | None:
        """Return the next frame, or None when none comes within ``timeout_s`` [s]."""

    def send(self, frame: Frame) -> bool:
        """Send ``frame`` without waiting; returns whether the bus had room."""


class RealTimeExecutor:
    """Runs ``node`` on ``port``.

    ``observe``   called with the time after each wake-up that leaves time to the next deadline
    """

    def __init__(
        self,
        node: Node,
        port: Port,
        clock_ns: Callable[[], int] = time.monotonic_ns,
        observe: Callable[[int], None] = unobserved,
    ) -> None:
        self._node = node
        self._port = port
        self._clock_ns = clock_ns
        self._observe = observe
        self._lateness = DurationStatistics()
        self._overdue = self._wake_ups = self._full_wake_ups = 0
        self._frames_received = self._frames_sent = self._frames_refused = 0
        self._duration_ns = self._busy_ns = 0

    def report(self) -> dict[str, Any]:
        """Return the figures of the run so far, ready for JSON.

        ``lateness``         how long after its deadline each tick ran
        ``overdue``          wake-ups that ended after the next deadline. Deadlines that are close
                             together cause this in a healthy node too; the node itself counts
                             missed periods
        ``wake_ups``         turns of the loop
        ``full_wake_ups``    wake-ups that reached FRAMES_PER_WAKE_UP_MAX
        ``frames_refused``   frames of the node for which the bus had no room; they are lost
        ``busy_fraction``    part of ``duration_s`` spent outside of waiting
        """
        return {
            "lateness": self._lateness.report(),
            "overdue": self._overdue,
            "wake_ups": self._wake_ups,
            "full_wake_ups": self._full_wake_ups,
            "frames_received": self._frames_received,
            "frames_sent": self._frames_sent,
            "frames_refused": self._frames_refused,
            "duration_s": self._duration_ns / NS_PER_S,
            "busy_fraction": self._busy_ns / self._duration_ns if self._duration_ns else 0.0,
        }

    def run(self, should_stop: Callable[[], bool]) -> None:
        """Run until the node has finished or ``should_stop()``; raises what the port raises.

        ``should_stop`` is called once per wake-up, at least every WAIT_NS_MAX.
        """
        start_ns = self._clock_ns()
        before_ns = passed_ns = start_ns
        while not (self._node.finished or should_stop()):
            first = self._wait(before_ns)
            woken_ns = now_ns = self._clock_ns()
            self._wake_ups += 1
            if first is not None:
                now_ns = self._drain(first, passed_ns, now_ns)
            self._tick(now_ns)
            passed_ns = now_ns
            # Read again, because the next wait starts here and not at now_ns.
            before_ns = self._clock_ns()
            if self._node.deadline_ns <= before_ns:
                self._overdue += 1
            else:
                self._observe(before_ns)
            self._busy_ns += before_ns - woken_ns
            self._duration_ns = before_ns - start_ns

    def _wait(self, before_ns: int) -> Received | None:
        wait_ns = min(self._node.deadline_ns - before_ns, WAIT_NS_MAX)
        return self._port.recv(max(wait_ns, 0) / NS_PER_S)

    def _drain(self, first: Received, passed_ns: int, now_ns: int) -> int:
        """Pass ``first`` and the frames waiting behind it to the node, up to the limit.

        ``passed_ns``  the last time that was passed to the node [ns]
        ``now_ns``     the reading of the clock, later than ``first`` [ns]

        Returns a reading of the clock that is later than all of them [ns].
        """
        received: Received | None = first
        taken = 0
        while received is not None:
            frame, arrival_ns = received
            passed_ns = now_ns if arrival_ns is None else min(max(arrival_ns, passed_ns), now_ns)
            if not frame.flags & ERROR:
                self._send(self._node.on_frame(frame, passed_ns))
                self._frames_received += 1
            taken += 1
            if taken == FRAMES_PER_WAKE_UP_MAX:
                self._full_wake_ups += 1
                break
            received = self._port.recv(0.0)
            if received is not None and (
                received.arrival_ns is None or received.arrival_ns > now_ns
            ):
                now_ns = self._clock_ns()
        return now_ns

    def _tick(self, now_ns: int) -> None:
        """Tick while the node's deadline is due; raises RuntimeError if that does not end."""
        for _ in range(TICKS_PER_WAKE_UP_MAX):
            lateness_ns = now_ns - self._node.deadline_ns
            if lateness_ns < 0:
                return
            self._lateness.record(lateness_ns)
            self._send(self._node.on_tick(now_ns))
        raise RuntimeError(
            f"the node's deadline does not move on: {TICKS_PER_WAKE_UP_MAX} ticks at {now_ns} ns"
        )

    def _send(self, frames: Sequence[Frame]) -> None:
        for frame in frames:
            if self._port.send(frame):
                self._frames_sent += 1
            else:
                self._frames_refused += 1
