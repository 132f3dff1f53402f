"""How long a frame takes to another program on the same bus, and its echo back.

Both ends are nodes in the executor that the programs use, each in a process of its own. The two
identifiers are the highest, so the probe has the lowest priority on a bus in use.
"""

import argparse
import multiprocessing
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from multiprocessing.connection import Connection
from typing import NamedTuple

from ...runtime.bus import BusError, shutting_down
from ...runtime.frame import Frame
from ...runtime.host import RealTimeRequest, real_time
from ...runtime.node import NEVER_NS, NS_PER_MS, NS_PER_S
from ...runtime.periodic import PeriodicTimer
from ...runtime.port import open_port
from ...runtime.program import StopRequest
from ...runtime.real_time import Port, RealTimeExecutor
from ...runtime.statistics import DurationStatistics, DurationSummary
from .wake_ups import Sliced, Slices

REQUEST_ID, ECHO_ID = 0x7FE, 0x7FF
PERIOD_NS = 10 * NS_PER_MS
START_S_MAX = 60.0
END_S_MAX = 10.0


class RoundTrip(NamedTuple):
    """Round trips at 100 a second; ``unanswered`` ones had no echo before the next request."""

    everything: DurationSummary
    undisturbed: DurationSummary
    unanswered: int
    steal_fraction: float | None


class EchoNode:
    """Answers every request with its payload."""

    deadline_ns = NEVER_NS
    finished = False

    def on_frame(self, frame: Frame, _now_ns: int) -> Sequence[Frame]:
        """Answer."""
        return (Frame(ECHO_ID, frame.data),) if frame.can_id == REQUEST_ID else ()

    def on_tick(self, _now_ns: int) -> Sequence[Frame]:
        """Is never due."""
        return ()


class RequestNode:
    """Sends a request every PERIOD_NS from ``start_ns`` to ``end_ns``, and times the answers."""

    def __init__(
        self, start_ns: int, end_ns: int, clock_ns: Callable[[], int] = time.monotonic_ns
    ) -> None:
        self._timer = PeriodicTimer(start_ns, PERIOD_NS)
        self._end_ns = end_ns
        self._clock_ns = clock_ns
        self._asked: tuple[bytes, int] | None = None
        self._slices: Slices[int] = Slices()
        self.unanswered = 0

    @property
    def deadline_ns(self) -> int:
        """When the next request is due [ns]."""
        return self._timer.deadline_ns

    @property
    def finished(self) -> bool:
        """Whether the time is up."""
        return self._timer.deadline_ns >= self._end_ns

    def on_frame(self, frame: Frame, _now_ns: int) -> Sequence[Frame]:
        """Time an answer: up to now, when it can be used, and not to its arrival in the kernel."""
        if self._asked is not None and frame.can_id == ECHO_ID and frame.data == self._asked[0]:
            now_ns = self._clock_ns()
            self._slices.add(now_ns - self._asked[1], now_ns)
            self._asked = None
        return ()

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        """Send a request."""
        self.unanswered += self._asked is not None
        data = self._timer.advance(now_ns).to_bytes(4, "little")
        self._asked = (data, self._clock_ns())
        return (Frame(REQUEST_ID, data),)

    def result(self) -> Sliced[int]:
        """Return what was measured."""
        return self._slices.result()


def measure_round_trip(port: Port, seconds: float, spin_ns: int) -> RoundTrip:
    """Send requests to the echo for ``seconds``; raises BusError."""
    start_ns = time.monotonic_ns() + PERIOD_NS
    node = RequestNode(start_ns, start_ns + round(seconds * NS_PER_S))
    RealTimeExecutor(node, port, spin_ns=spin_ns).run(lambda: False)
    sliced = node.result()
    return RoundTrip(
        _summary(sliced.samples),
        _summary(sliced.undisturbed),
        node.unanswered,
        sliced.steal_fraction,
    )


@contextmanager
def echoing(
    options: argparse.Namespace, request: RealTimeRequest, seconds: float
) -> Iterator[None]:
    """Run an echo on the same bus until the end of the block, for ``seconds`` at the longest.

    ``options``  of the bus, parsed, and ``fast_socketcan``

    Raises BusError when the bus cannot be opened twice.
    """
    context = multiprocessing.get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_echo, args=(options, request, seconds, sender), daemon=True)
    process.start()
    sender.close()
    try:
        obstacle = _obstacle(receiver)
        if obstacle:
            raise BusError(obstacle)
        yield
    finally:
        receiver.close()
        process.terminate()
        process.join(END_S_MAX)
        process.kill()


def _obstacle(receiver: Connection) -> str:
    """Wait until the echo is ready; returns why it is not, else an empty text."""
    try:
        return str(receiver.recv()) if receiver.poll(START_S_MAX) else "the echo does not start"
    except EOFError:
        return "the echo has not started"


def _echo(
    options: argparse.Namespace, request: RealTimeRequest, seconds: float, sender: Connection
) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the probe, which ends us
    stop = StopRequest()
    stop.end_at(time.monotonic_ns() + round(seconds * NS_PER_S))
    try:
        opened = open_port(options, [REQUEST_ID], fast=options.fast_socketcan)
    except BusError as error:
        sender.send(str(error))
        return
    with shutting_down(opened.port), stop.on_signals(), real_time(request):
        sender.send("")
        RealTimeExecutor(EchoNode(), opened.port).run(stop)


def _summary(durations_ns: Sequence[int]) -> DurationSummary:
    statistics = DurationStatistics()
    for duration_ns in durations_ns:
        statistics.record(duration_ns)
    return statistics.summary()
