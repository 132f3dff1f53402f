"""What the two programs share: start, signals, report, exit status.

After the line "ready" every run ends with its report: when the node has finished, the time is up, a
signal comes, the bus fails or the node detects a fault in itself. Options that could lose a report
are refused before the run.
"""

import argparse
import os
import select
import signal
import sys
import threading
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from enum import IntEnum
from types import FrameType
from typing import Any, NamedTuple, TextIO

import can

from .bus import BusError, shutting_down
from .connection import Connection, ConnectionFigures
from .host import RealTimeRequest, StealClock, real_time
from .node import NEVER_NS, NS_PER_S, NS_PER_US, N
from .own_part import PartError
from .port import open_port
from .real_time import LoopFigures, RealTimeExecutor, unobserved
from .recording import Recording, RecordingPort
from .report import connection_report, host_report, run_report, write_json
from .screen import Observer, Screen
from .settings import Settings, SettingsError
from .summary import summary_lines
from .thresholds import Condition, Ending, Quantity, failures

FINISHED = "finished"
"""``ended_by`` of a run that the node itself has ended."""
BLOCKED_S = 2.0
"""How long a line waits for a full pipe; then this line and all later ones are dropped."""


class ExitStatus(IntEnum):
    """Exit status of the programs."""

    OK = 0
    SETTINGS = 2
    BUS = 3
    OUTPUT = 4
    """A file could not be written."""
    SAFE_STATE = 5
    """The node has detected a fault in itself and stays in its safe state."""
    CONDITION = 6
    """The run has met a condition of ``--fail-if``."""
    INTERRUPTED = 130
    """Ctrl-C or SIGTERM outside of a run. An interrupted run ends with OK and a report."""


class StopRequest:
    """Becomes true when the run has to end, and keeps the reason."""

    def __init__(self, clock_ns: Callable[[], int] = time.monotonic_ns) -> None:
        self._clock_ns = clock_ns
        self._end_ns = NEVER_NS
        self.reason = ""

    def __call__(self) -> bool:
        """Whether the run is to end."""
        if not self.reason and self._clock_ns() >= self._end_ns:
            self.reason = "duration"
        return bool(self.reason)

    def end_at(self, end_ns: int) -> None:
        """Let the run end at ``end_ns`` at the latest."""
        self._end_ns = end_ns

    @contextmanager
    def on_signals(self) -> Iterator[None]:
        """Let SIGINT, SIGTERM and SIGHUP end the run, within the block.

        SIGHUP comes with the end of the terminal; below nohup it stays ignored. Terminals and
        wrappers may send a signal twice: the second one must not cost the report.
        """
        numbers = [signal.SIGINT, signal.SIGTERM]
        if sys.platform != "win32" and signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
            numbers.append(signal.SIGHUP)
        previous = {number: signal.getsignal(number) for number in numbers}
        for number in previous:
            signal.signal(number, self._take_signal)
        try:
            yield
        finally:
            for number, handler in previous.items():
                signal.signal(number, handler)

    def _take_signal(self, number: int, _frame: FrameType | None) -> None:
        self.reason = self.reason or signal.Signals(number).name


class _Run(NamedTuple):
    """Result of a run, without the node's own report.

    ``failure``  of the bus or of a part from another package; empty if there is none
    ``status``   exit status of the failure
    """

    ended_by: str
    failure: str
    status: ExitStatus
    loop: LoopFigures
    connection: ConnectionFigures
    host: Mapping[str, Any]


def run_node(
    name: str,
    options: argparse.Namespace,
    settings: Settings,
    make_node: Callable[[int], N],
    conclude: Callable[[N], None] = lambda _node: None,
    can_ids: Collection[int] | None = None,
    notice: str = "",
    ending: Ending | None = None,
) -> ExitStatus:
    """Open the bus, run the node to its end in real time, print and write the report.

    ``make_node``  called as ``make_node(start_ns)`` on the monotonic clock [ns]; must be quick,
                   because the first tick is due at this time
    ``conclude``   writes and prints the program's own additions, after the report
    ``can_ids``    identifiers the node receives; None: all
    ``notice``     printed on standard error when the bus is open
    ``ending``     the verdict, printed last, and the quantities of ``--fail-if``

    Returns the exit status. A failing bus, node, part of another package or recording leaves a
    report too. Raises BusError if the bus cannot be opened, OSError if a file cannot be written.
    """
    opened = open_port(options, can_ids, fast=options.fast_socketcan)
    screen = Screen(name, sys.stderr)
    connection = Connection(
        opened, options.reconnect_limit if options.reconnect else 0.0, screen.line
    )
    stop = StopRequest()
    # Report and recording are written before the shut-down, which may take seconds or fail.
    with shutting_down(connection), ExitStack() as stack:
        # Before the signals are handled: opening a file may block, and Ctrl-C has to end that.
        recording = _start_recording(options, opened.channel)
        stack.enter_context(stop.on_signals())
        if notice:
            say(name, notice, sys.stderr)
        say(name, f"ready on {opened.description}")
        try:
            node, run = _run_in_real_time(options, connection, stop, make_node, recording, screen)
        finally:
            recorded = None if recording is None else recording.close()
        if run.failure:
            say(name, f"error: {run.failure}", sys.stderr)
        figures = node.report()
        fault = str(figures.get("failure", ""))
        if fault:
            say(name, f"error: safe state: {fault}", sys.stderr)
        ended_by = f"safe state: {fault}" if fault and run.ended_by == FINISHED else run.ended_by
        report = run_report(name, ended_by, opened.description, settings, run.loop, figures)
        report["connection"] = connection_report(run.connection)
        report["host"] = run.host
        report["recording"] = None if recorded is None else recorded._asdict()
        if options.report is not None:
            write_json(options.report, report)
        for line in summary_lines(report):
            say(name, line)
        if recorded is not None and recorded.failure:
            say(name, f"error: {recorded.file}: {recorded.failure}", sys.stderr)
        conclude(node)
        status = ExitStatus.OK
        if ending is not None:
            status = fail_status(name, options.fail_if, ending.quantities, report)
            say(name, f"verdict: {ending.verdict(report)}")
    if run.failure:
        return run.status
    if fault:
        return ExitStatus.SAFE_STATE
    if status is ExitStatus.OK and recorded is not None and recorded.failure:
        return ExitStatus.OUTPUT
    return status


def _start_recording(options: argparse.Namespace, channel: str) -> Recording | None:
    """Start the recorder, before the run, whose priority it must not inherit."""
    if options.record is None:
        return None
    return Recording(options.record, channel.replace(" ", "_"))


def _run_in_real_time(
    options: argparse.Namespace,
    connection: Connection,
    stop: StopRequest,
    make_node: Callable[[int], N],
    recording: Recording | None,
    screen: Screen,
) -> tuple[N, _Run]:
    """Make the node and run it to its end."""
    request = RealTimeRequest(options.priority, options.cpu, options.lock_memory)
    failure, status = "", ExitStatus.OK
    with real_time(request) as answers:
        steal = StealClock()
        start_ns = time.monotonic_ns()
        if options.duration is not None:
            stop.end_at(start_ns + round(options.duration * NS_PER_S))
        node = make_node(start_ns)
        port = connection if recording is None else RecordingPort(connection, recording)
        observe = unobserved if options.quiet else Observer(node.view, screen, start_ns)
        executor = RealTimeExecutor(
            node, port, spin_ns=options.spin_us * NS_PER_US, observe=observe
        )
        screen.start()
        try:
            executor.run(stop)
        except BusError as error:
            failure, status = str(error), ExitStatus.BUS
        except PartError as error:
            failure, status = str(error), ExitStatus.SETTINGS
        finally:
            screen.close()
    ended_by = failure or stop.reason or FINISHED
    host = host_report(answers, steal.fraction())
    return node, _Run(ended_by, failure, status, executor.figures, connection.figures, host)


@contextmanager
def handled(number: int, handler: Any) -> Iterator[None]:
    """Handle a signal with ``handler`` within the block; only in the main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread can handle signals
        return
    before = signal.signal(number, handler)
    try:
        yield
    finally:
        signal.signal(number, before)


def interrupted_by_sigterm() -> AbstractContextManager[None]:
    """Let SIGTERM end the block as Ctrl-C does, so that it leaves nothing behind."""
    return handled(signal.SIGTERM, signal.default_int_handler)


def run_main(name: str, main: Callable[[], int]) -> int:
    """Call ``main``; turns errors that a user can cause into one line and an exit status."""
    try:
        with interrupted_by_sigterm():
            status = main()
        print(end="", flush=True)
        return status
    except SettingsError as error:
        lines, status = str(error).splitlines(), ExitStatus.SETTINGS
    except (BusError, can.CanError) as error:
        lines, status = [str(error)], ExitStatus.BUS
    except BrokenPipeError:
        # The reader has gone, as after "| head".
        _silence(sys.stdout)
        lines, status = [], ExitStatus.OK
    except OSError as error:
        where = error.filename2 or error.filename
        cause = error.strerror or str(error)
        lines = [f"{where}: {cause}" if where else cause]
        status = ExitStatus.OUTPUT
    except UnicodeEncodeError as error:
        # Names on the command line may have any bytes; printing and storing need text.
        lines, status = [f"{error.object[:60]}: is not UTF-8 text"], ExitStatus.OUTPUT
    except KeyboardInterrupt:
        lines, status = ["interrupted"], ExitStatus.INTERRUPTED
    for line in lines:
        say(name, f"error: {line}", sys.stderr)
    return status


def fail_status(
    name: str,
    conditions: Sequence[Condition],
    quantities: Mapping[str, Quantity],
    report: Mapping[str, Any],
) -> ExitStatus:
    """Print a line for each ``--fail-if`` that a run meets; returns CONDITION if there is one."""
    lines = failures(conditions, quantities, report)
    for line in lines:
        say(name, line, sys.stderr)
    return ExitStatus.CONDITION if lines else ExitStatus.OK


def say(name: str, text: str, stream: TextIO | None = None) -> None:
    """Print one line to ``stream``, standard output unless given, at once.

    A closed pipe, a full disk or a reader that reads no further must neither keep a run from its
    end nor cost its report.
    """
    stream = stream or sys.stdout
    try:
        if not _takes_a_line(stream):
            raise BlockingIOError
        print(f"{name}: {text}", file=stream, flush=True)
    except OSError:
        _silence(stream)


def _takes_a_line(stream: TextIO) -> bool:
    """Whether ``stream`` takes a line without blocking, now or within BLOCKED_S.

    A terminal that somebody has stopped is waited for: they see it, and can let it go on.
    """
    try:
        descriptor = stream.fileno()
    except OSError:  # in memory
        return True
    if stream.isatty() or os.name != "posix":  # elsewhere select knows sockets only
        return True
    return bool(select.select([], [descriptor], [], BLOCKED_S)[1])


def _silence(stream: TextIO) -> None:
    """Redirect ``stream`` to nowhere, including what Python still buffers."""
    with open(os.devnull, "w", encoding="utf-8") as nowhere:
        os.dup2(nowhere.fileno(), stream.fileno())
