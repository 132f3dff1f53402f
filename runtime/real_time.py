"""Runs one node in real time: waits for a frame or the node's deadline, whichever comes first.

A wake-up, in this order:

1. Read the clock once. That reading is the time of everything below.
2. Hand over every frame that waits, oldest first, at most FRAMES_PER_WAKE_UP_MAX: a flood must not
   keep the node from ticking. What is left waits for the next wake-up, which follows at once.
   Error frames are the port's business and are not handed over.
   Where the port knows when a frame arrived, that is the time passed to the node, kept between the
   last reading and this one: a node never gets a time in the future, nor one before its last.
3. Tick while the node's deadline is due.

Deadlines are absolute, so that being late once makes nothing late after it. The last of a wait may
be spent spinning: looking at clock and port without sleeping, which takes all of a processor and
none of the time that a host needs to wake a program up.
"""

import time
from collections.abc import Callable, Sequence
from typing import NamedTuple, Protocol

from .frame import ERROR, Frame
from .node import NS_PER_S, Node
from .statistics import DurationStatistics, DurationSummary

FRAMES_PER_WAKE_UP_MAX = 256
TICKS_PER_WAKE_UP_MAX = 10_000
"""Ticks at one reading of the clock before the node is called stuck. Signals only ask for the end
of a run, so a node that kept its executor here could not even be interrupted."""
WAIT_NS_MAX = 50_000_000
"""Longest wait, so that a request to stop is noticed."""


def unobserved(_now_ns: int) -> None:
    """Observe nothing."""


class Received(NamedTuple):
    """A frame, and when it arrived on the monotonic clock [ns]; None where that is unknown."""

    frame: Frame
    arrival_ns: int | None


class Port(Protocol):
    """What a node sends to and receives from."""

    def recv(self, timeout_s: float) -> Received | None:
        """Return the next frame, or None when none comes within ``timeout_s`` [s]."""
        ...

    def send(self, frame: Frame) -> bool:
        """Hand ``frame`` to the bus without waiting; returns whether it had room."""
        ...


class LoopFigures(NamedTuple):
    """What a run was like.

    ``lateness``         how long after its deadline each tick ran
    ``unwaited``         how often the next deadline had come by the end of a wake-up, so that
                         nothing was waited for. Deadlines that are close together do that to a
                         healthy node; what a node misses it counts itself
    ``wake_ups``         how often the loop went round
    ``full_wake_ups``    how often FRAMES_PER_WAKE_UP_MAX cut the frames of a wake-up short
    ``frames_refused``   frames of the node the bus had no room for; they are not sent again
    ``duration_ns``      from the first reading of the clock to the last [ns]
    ``busy_ns``          of which not waiting [ns]
    """

    lateness: DurationSummary
    unwaited: int
    wake_ups: int
    full_wake_ups: int
    frames_received: int
    frames_sent: int
    frames_refused: int
    duration_ns: int
    busy_ns: int


class RealTimeExecutor:
    """Runs ``node`` on ``port``.

    ``clock_ns``  monotonic clock [ns]
    ``spin_ns``   how long before a deadline the spinning begins [ns]
    ``observe``   is called with the time after each wake-up with time left to the next deadline
    """

    def __init__(
        self,
        node: Node,
        port: Port,
        clock_ns: Callable[[], int] = time.monotonic_ns,
        spin_ns: int = 0,
        observe: Callable[[int], None] = unobserved,
    ) -> None:
        self._node = node
        self._port = port
        self._clock_ns = clock_ns
        self._spin_ns = spin_ns
        self._observe = observe
        self._lateness = DurationStatistics()
        self._unwaited = 0
        self._wake_ups = 0
        self._full_wake_ups = 0
        self._frames_received = 0
        self._frames_sent = 0
        self._frames_refused = 0
        self._duration_ns = 0
        self._busy_ns = 0

    @property
    def figures(self) -> LoopFigures:
        """Figures of the run so far."""
        return LoopFigures(
            self._lateness.summary(),
            self._unwaited,
            self._wake_ups,
            self._full_wake_ups,
            self._frames_received,
            self._frames_sent,
            self._frames_refused,
            self._duration_ns,
            self._busy_ns,
        )

    def run(self, should_stop: Callable[[], bool]) -> None:
        """Run until the node has finished or ``should_stop()``; what the port raises comes through.

        ``should_stop`` is asked once a wake-up, at least every WAIT_NS_MAX.
        """
        start_ns = self._clock_ns()
        before_ns = told_ns = start_ns
        while not (self._node.finished or should_stop()):
            first = self._wait(before_ns)
            now_ns = self._clock_ns()
            self._wake_ups += 1
            if first is not None:
                self._drain(first, told_ns, now_ns)
            self._tick(now_ns)
            told_ns = now_ns
            # Read again, because the wait that follows is counted from here and not from now_ns.
            before_ns = self._clock_ns()
            if self._node.deadline_ns <= before_ns:
                self._unwaited += 1
            else:
                self._observe(before_ns)
            self._busy_ns += before_ns - now_ns
            self._duration_ns = before_ns - start_ns

    def _wait(self, before_ns: int) -> Received | None:
        """Return the next frame, or None when the deadline comes first, or WAIT_NS_MAX."""
        deadline_ns = self._node.deadline_ns
        wait_ns = min(deadline_ns - before_ns - self._spin_ns, WAIT_NS_MAX)
        received = self._port.recv(max(wait_ns, 0) / NS_PER_S)
        if self._spin_ns and wait_ns < WAIT_NS_MAX:
            while received is None and self._clock_ns() < deadline_ns:
                received = self._port.recv(0.0)
        return received

    def _drain(self, first: Received, told_ns: int, now_ns: int) -> None:
        """Hand over ``first`` and what waits behind it, as far as one wake-up goes.

        ``told_ns``  the last time that was passed to the node before [ns]
        """
        received: Received | None = first
        taken = 0
        while received is not None:
            frame, arrival_ns = received
            told_ns = now_ns if arrival_ns is None else min(max(arrival_ns, told_ns), now_ns)
            if not frame.flags & ERROR:
                self._send(self._node.on_frame(frame, told_ns))
                self._frames_received += 1
            taken += 1
            if taken == FRAMES_PER_WAKE_UP_MAX:
                self._full_wake_ups += 1
                break
            received = self._port.recv(0.0)

    def _tick(self, now_ns: int) -> None:
        """Tick while the node's deadline is due; raises RuntimeError when that does not end."""
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
