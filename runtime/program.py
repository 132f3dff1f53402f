"""What the two programs share: command line, start, signals, report, exit status.

From the line "ready" on a run ends with its report, whether the node has finished, time is up, a
signal came, the bus failed or the node has found a fault in itself. What could lose a report is
refused before there is a run.
"""

import argparse
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager
from enum import IntEnum
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple, TextIO, TypeVar

import can

from ..command_line import command_parser
from .bus import BusError, add_bus_arguments, shutting_down
from .connection import Connection, ConnectionFigures
from .host import RealTimeRequest, StealClock, real_time
from .node import NEVER_NS, NS_PER_S, NS_PER_US, N
from .option_types import (
    SPIN_US_MAX,
    output_file,
    priority,
    recording_file,
    seconds,
    spin_us,
)
from .own_part import PartError
from .port import open_port
from .real_time import LoopFigures, RealTimeExecutor, unobserved
from .recording import Recording, RecordingPort
from .report import connection_report, host_report, run_report, write_json
from .screen import Observer, Screen
from .settings import (
    Settings,
    SettingsError,
    SharedTable,
    load_settings,
    preset_names,
    read_preset,
)
from .summary import summary_lines

PATIENCE_S = 60.0
"""How long ``--reconnect`` waits for the bus by default."""


FINISHED = "finished"
"""What ended a run that the node itself has ended."""


class ExitStatus(IntEnum):
    """Why a program has ended, for the shell."""

    OK = 0
    SETTINGS = 2
    BUS = 3
    OUTPUT = 4
    """A file could not be written."""
    SAFE_STATE = 5
    """The node has found a fault in itself, and has gone to its safe state for good."""
    INTERRUPTED = 130
    """By Ctrl-C or SIGTERM outside of a run; one that is interrupted ends with OK and a report."""


S = TypeVar("S", bound=Settings)


class StopRequest:
    """Becomes true when the run is to end, and remembers why."""

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
        """Let SIGINT, SIGTERM and SIGHUP ask for the end until the end of the block.

        SIGHUP is the end of the terminal or of the connection to it; below nohup it is ignored, and
        stays so.

        However often they come: terminals and the wrappers that pass signals on send them twice,
        and the second must not cost the report.
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
    """What has become of a run, beside what the node itself reports.

    ``failure``  of the bus, or of a part from another package; empty when none has failed
    ``status``   what follows from the failure
    """

    ended_by: str
    failure: str
    status: ExitStatus
    loop: LoopFigures
    connection: ConnectionFigures
    host: Mapping[str, Any]


def make_parser(
    name: str, doc: str | None, example: str, preset_package: str
) -> argparse.ArgumentParser:
    """Return a parser with the options both programs have; ``command_parser`` has the arguments."""
    parser = command_parser(name, doc, example, "[SETTINGS.toml] [options]")
    add_settings_arguments(parser, preset_package)
    parser.add_argument("--report", type=output_file, metavar="FILE", help="write a report, JSON")
    parser.add_argument(
        "--record",
        type=recording_file,
        metavar="FILE",
        help="write every frame: .log .asc .blf .csv .db .trc .mf4",
    )
    parser.add_argument(
        "-q", "--quiet", action="store_true", help="print nothing while running but errors"
    )
    parser.add_argument(
        "--duration", type=seconds, metavar="SECONDS", help="end after this time at the latest"
    )
    add_real_time_arguments(parser)
    add_bus_arguments(parser)
    group = parser.add_argument_group("a bus that fails")
    group.add_argument(
        "--reconnect", action="store_true", help="reopen a bus that was lost, and continue"
    )
    group.add_argument(
        "--reconnect-limit",
        type=seconds,
        default=PATIENCE_S,
        metavar="SECONDS",
        help="how long the bus may stay away (default: %(default)g)",
    )
    group.add_argument(
        "--no-fast-socketcan",
        dest="fast_socketcan",
        action="store_false",
        help="open SocketCAN through python-can too",
    )
    return parser


def add_settings_arguments(parser: argparse.ArgumentParser, preset_package: str) -> None:
    """Add what ``load_program_settings`` reads."""
    presets = ", ".join(preset_names(preset_package))
    parser.add_argument(
        "settings", nargs="?", type=Path, metavar="SETTINGS.toml", help="settings file"
    )
    parser.add_argument("--preset", metavar="NAME", help=f"settings below the file's: {presets}")
    parser.add_argument(
        "--set",
        dest="overrides",
        action="append",
        default=[],
        metavar="TABLE.KEY=VALUE",
        help="one setting on top of the file; repeatable",
    )


def add_real_time_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what a program may request of the host, the same for the programs and the probe."""
    group = parser.add_argument_group("real time, as far as the host grants it")
    group.add_argument(
        "--priority",
        type=priority,
        default=50,
        metavar="0..99",
        help="SCHED_FIFO priority; 0 does not request it (default: %(default)s)",
    )
    group.add_argument("--cpu", type=int, metavar="N", help="run on processor N only")
    group.add_argument(
        "--no-memory-lock", dest="lock_memory", action="store_false", help="let memory be paged out"
    )
    group.add_argument(
        "--spin-us",
        type=spin_us,
        default=0,
        metavar="US",
        help=f"busy-wait this long before a deadline, 0 to {SPIN_US_MAX}; occupies a processor",
    )


def load_program_settings(
    model: type[S],
    preset_package: str,
    options: argparse.Namespace,
    overrides: Sequence[str] = (),
    shared: SharedTable | None = None,
) -> S:
    """Return the settings that the command line asks for; raises SettingsError.

    ``overrides``  further ``table.key=value``, on top of those of ``--set``
    """
    preset = read_preset(preset_package, options.preset) if options.preset else None
    own = [*options.overrides, *overrides]
    return load_settings(model, preset, options.settings, own, shared)


def run_node(
    name: str,
    options: argparse.Namespace,
    settings: Settings,
    make_node: Callable[[int], N],
    conclude: Callable[[N], None] = lambda _node: None,
    can_ids: Collection[int] | None = None,
    notice: str = "",
) -> ExitStatus:
    """Open the bus, run the node to its end in real time, print and write the report.

    ``make_node``  called as ``make_node(start_ns)``, on the monotonic clock [ns]; the first tick is
                   due then, so it must not take long
    ``conclude``   writes and prints the program's own additions, after the report
    ``can_ids``    identifiers the node receives; None for all
    ``notice``     is printed on standard error when the bus is open

    Returns the exit status: a bus, a node, a part of another package or a recording that fails
    leaves a report too. Raises BusError when the bus cannot be opened, and OSError when a file
    cannot be written.
    """
    opened = open_port(options, can_ids, fast=options.fast_socketcan)
    screen = Screen(name, sys.stderr)
    connection = Connection(
        opened, options.reconnect_limit if options.reconnect else 0.0, screen.line
    )
    stop = StopRequest()
    # What is to be kept is written before the shut-down, which may take seconds or fail.
    with shutting_down(connection), ExitStack() as stack:
        # A file may take for ever to open, which Ctrl-C has to end: before the signals are taken.
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
    if run.failure:
        return run.status
    if fault:
        return ExitStatus.SAFE_STATE
    return ExitStatus.OUTPUT if recorded is not None and recorded.failure else ExitStatus.OK


def _start_recording(options: argparse.Namespace, channel: str) -> Recording | None:
    """Start what was asked for; before the run, whose priority the recorder must not have."""
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
    """Let ``handler`` take a signal in the block, as far as that is in the main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield  # signals are for the main thread
        return
    before = signal.signal(number, handler)
    try:
        yield
    finally:
        signal.signal(number, before)


def interrupted_by_sigterm() -> AbstractContextManager[None]:
    """Let SIGTERM end what is in the block as Ctrl-C does, so that it leaves nothing behind."""
    return handled(signal.SIGTERM, signal.default_int_handler)


def run_main(name: str, main: Callable[[], int]) -> int:
    """Call ``main``; turns what a user can cause into one line on standard error and a status."""
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
        # Nobody reads on, as after "| head"; that is no mistake.
        _silence(sys.stdout)
        lines, status = [], ExitStatus.OK
    except OSError as error:
        where = error.filename2 or error.filename
        cause = error.strerror or str(error)
        lines = [f"{where}: {cause}" if where else cause]
        status = ExitStatus.OUTPUT
    except UnicodeEncodeError as error:
        # Names on the command line may have any bytes; what prints or stores them wants text.
        lines, status = [f"{error.object[:60]}: is not UTF-8 text"], ExitStatus.OUTPUT
    except KeyboardInterrupt:
        lines, status = ["interrupted"], ExitStatus.INTERRUPTED
    for line in lines:
        say(name, f"error: {line}", sys.stderr)
    return status


def say(name: str, text: str, stream: TextIO | None = None) -> None:
    """Print one line to ``stream``, standard output unless given, at once.

    A reader that has gone or a disk that is full must neither end a run nor cost its report.
    """
    stream = stream or sys.stdout
    try:
        print(f"{name}: {text}", file=stream, flush=True)
    except OSError:
        _silence(stream)


def _silence(stream: TextIO) -> None:
    """Have ``stream`` written to nowhere, also what Python still holds and writes at the end."""
    with open(os.devnull, "w", encoding="utf-8") as nowhere:
        os.dup2(nowhere.fileno(), stream.fileno())
