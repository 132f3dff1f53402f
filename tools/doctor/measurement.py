"""Measures wake-ups at every rate and round trips, without rights and with them.

A round trip is how long a frame takes to another program on the same bus, and its echo back. Both
ends are nodes in the executor that the programs use, each in a process of its own. The two
identifiers are the highest, so the measurement has the lowest priority on a bus in use.
"""

import argparse
import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from multiprocessing.connection import Connection
from typing import NamedTuple

from ...closed_loop.processes.process_group import launched_broker
from ...runtime.exit_status import BusError
from ...runtime.frame import Frame
from ...runtime.node import NEVER_NS, NS_PER_MS, NS_PER_S, NS_PER_US
from ...runtime.node.periodic import PeriodicTimer
from ...runtime.node.real_time_loop import Port, RealTimeExecutor
from ...runtime.node.statistics import DurationSummary
from ...runtime.port.interface_choice import choose_bus
from ...runtime.port.port import OpenPort, open_port
from ...runtime.port.python_can import shutting_down
from ...runtime.program.priority_and_memory_lock import (
    HostAnswer,
    RealTimeRequest,
    StealClock,
    real_time,
)
from ...runtime.program.stop_request import StopRequest
from .wake_ups import WakeUps, measure_wake_ups, summary_of

REQUEST_ID, ECHO_ID = 0x7FE, 0x7FF
PERIOD_NS = 10 * NS_PER_MS
START_S_MAX = 60.0
END_S_MAX = 10.0


class RoundTrip(NamedTuple):
    """Round trips at 100 a second; ``unanswered`` ones had no echo before the next request."""

    times: DurationSummary
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
        self.times_ns: list[int] = []
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
            self.times_ns.append(self._clock_ns() - self._asked[1])
            self._asked = None
        return ()

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        """Send a request."""
        self.unanswered += self._asked is not None
        data = self._timer.advance(now_ns).to_bytes(4, "little")
        self._asked = (data, self._clock_ns())
        return (Frame(REQUEST_ID, data),)


def measure_round_trip(port: Port, seconds: float, spin_ns: int) -> RoundTrip:
    """Send requests to the echo for ``seconds``; raises BusError."""
    start_ns = time.monotonic_ns() + PERIOD_NS
    node = RequestNode(start_ns, start_ns + round(seconds * NS_PER_S))
    steal = StealClock()
    RealTimeExecutor(node, port, spin_ns=spin_ns).run(lambda: False)
    return RoundTrip(summary_of(node.times_ns), node.unanswered, steal.fraction())


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
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the doctor, which ends us
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


RATES_HZ = (100, 500, 1000)
ORDINARY, REAL_TIME = "ordinary", "real-time"
REAL_TIME_RIGHTS = ("real-time priority", "memory lock")
"""The host's rights that an ordinary user is refused."""
ECHO_GRACE_S = 60.0


class Measured(NamedTuple):
    """What was measured with one set of rights.

    ``round_trip``  None where it could not be measured; ``obstacle`` is the reason
    """

    rights: str
    answers: list[HostAnswer]
    wake_ups: list[WakeUps]
    round_trip: RoundTrip | None
    obstacle: str


class Measurement(NamedTuple):
    """The bus, and what was measured on it; ``refused`` is why nothing ran in real time."""

    bus: str
    driver: str
    measured: list[Measured]
    refused: str


Report = Callable[[str], None]
"""Called with the name of the next measurement."""


def steps(options: argparse.Namespace) -> int:
    """Return how many measurements of ``options.duration`` there are."""
    return (1 + _wants_rights(options)) * (len(RATES_HZ) + 1)


def measure(options: argparse.Namespace, report: Report) -> Measurement:
    """Measure; raises BusError when the bus cannot be opened or fails."""
    with _bus(options) as (bus, opened), shutting_down(opened.port):
        measured = [_measure(bus, opened, ORDINARY, RealTimeRequest(cpu=options.cpu), report)]
        request = RealTimeRequest(options.priority, options.cpu, options.lock_memory)
        refused = _refusal(request) if _wants_rights(options) else "not asked for"
        if not refused:
            measured.append(_measure(bus, opened, REAL_TIME, request, report))
        return Measurement(opened.description, opened.driver, measured, refused)


def _wants_rights(options: argparse.Namespace) -> bool:
    return bool(options.priority or options.lock_memory)


def _refusal(request: RealTimeRequest) -> str:
    """Return why the host grants none of the requested rights; empty when it grants any."""
    with real_time(request) as answers:
        rights = [answer for answer in answers if answer.name in REAL_TIME_RIGHTS]
    if any(answer.got for answer in rights):
        return ""
    return ", ".join(f"{answer.name} ({answer.detail})" for answer in rights)


def _measure(
    options: argparse.Namespace,
    opened: OpenPort,
    rights: str,
    request: RealTimeRequest,
    report: Report,
) -> Measured:
    spin_ns = options.spin_us * NS_PER_US
    wake_ups = []
    with real_time(request) as answers:
        for rate_hz in RATES_HZ:
            report(f"wake-ups at {rate_hz} Hz, {rights}")
            wake_ups.append(measure_wake_ups(opened.port, rate_hz, options.duration, spin_ns))
    report(f"round trips, {rights}")
    round_trip, obstacle = None, ""
    try:
        with echoing(options, request, options.duration + ECHO_GRACE_S), real_time(request):
            round_trip = measure_round_trip(opened.port, options.duration, spin_ns)
    except BusError as error:
        obstacle = str(error)
    return Measured(rights, answers, wake_ups, round_trip, obstacle)


@contextmanager
def _bus(options: argparse.Namespace) -> Iterator[tuple[argparse.Namespace, OpenPort]]:
    """Open the bus; where that is an emulated one that is not running, run one until the end."""
    choice = choose_bus(options)
    may_be_own = choice.interface == "emulated" and not getattr(options, "bus_kwargs", None)
    try:
        opened = _open(options)
    except BusError:
        if not may_be_own:
            raise
    else:
        yield options, opened
        return
    with (
        open(os.devnull, "w", encoding="utf-8") as nowhere,
        launched_broker((), nowhere) as address,
    ):
        bus = argparse.Namespace(**vars(options))
        bus.interface, bus.channel = "emulated", choice.channel or "probe"
        bus.bus_kwargs = {"address": address}
        yield bus, _open(bus)._replace(description=f"an emulated bus of its own ({choice.reason})")


def _open(options: argparse.Namespace) -> OpenPort:
    return open_port(options, [ECHO_ID], fast=options.fast_socketcan)
