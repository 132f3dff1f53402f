"""What the two programs share: command line, start, signals, report, exit status.

From the line "ready" on a run ends with its report, whether the node has finished, time is up, a
signal came or the bus failed. What could lose a report is refused before there is a run.
"""

import argparse
import math
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from enum import IntEnum
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple, Protocol, TextIO, TypeVar

from runtime.bus import BusError, BusPort, OpenBus, add_bus_arguments, open_bus, shutting_down
from runtime.host import RealTimeRequest, StealClock, priority, real_time
from runtime.node import NEVER_NS, NS_PER_S, Node
from runtime.real_time import LoopFigures, RealTimeExecutor
from runtime.recording import Recording, RecordingPort, recording_obstacle
from runtime.report import host_report, run_report, write_json
from runtime.settings import (
    Settings,
    SettingsError,
    load_settings,
    preset_names,
    read_preset,
)

DURATION_S_MAX = 1e9


class ExitStatus(IntEnum):
    """Why a program has ended, for the shell."""

    OK = 0
    SETTINGS = 2
    BUS = 3
    OUTPUT = 4
    """A file could not be written."""
    INTERRUPTED = 130
    """By Ctrl-C outside of a run; a run that is interrupted ends with OK and its report."""


class ReportingNode(Node, Protocol):
    """A node that can say what it has seen."""

    def report(self) -> Mapping[str, Any]:
        """Figures of the run so far; numbers, texts, and mappings of them."""
        ...


N = TypeVar("N", bound=ReportingNode)
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
        """Let SIGINT and SIGTERM ask for the end until the end of the block.

        However often they come: terminals and the wrappers that pass signals on send them twice,
        and the second must not cost the report.
        """
        previous = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
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

    ``failure``  of the bus; empty when it has not failed
    """

    ended_by: str
    failure: str
    loop: LoopFigures
    host: Mapping[str, Any]


def make_parser(name: str, description: str, preset_package: str) -> argparse.ArgumentParser:
    """Return a parser with the options both programs have."""
    presets = ", ".join(preset_names(preset_package))
    parser = argparse.ArgumentParser(prog=name, description=description, allow_abbrev=False)
    parser.add_argument("settings", nargs="?", type=Path, help="settings file, TOML")
    parser.add_argument("--preset", metavar="NAME", help=f"settings below the file: {presets}")
    parser.add_argument(
        "--set",
        dest="overrides",
        action="append",
        default=[],
        metavar="TABLE.KEY=VALUE",
        help="one setting on top of the file; may be given several times",
    )
    parser.add_argument("--report", type=output_file, metavar="FILE", help="write a report, JSON")
    parser.add_argument(
        "--record",
        type=recording_file,
        metavar="FILE",
        help="write every frame sent and received: .log .asc .blf .csv .db .trc .mf4",
    )
    parser.add_argument(
        "--duration", type=_seconds, metavar="SECONDS", help="end after this time at the latest"
    )
    group = parser.add_argument_group("real time, as far as the host grants it")
    group.add_argument(
        "--priority",
        type=priority,
        default=50,
        metavar="0..99",
        help="SCHED_FIFO priority; 0 does not ask for it (default: %(default)s)",
    )
    group.add_argument("--cpu", type=int, metavar="N", help="run on processor N only")
    group.add_argument("--no-memory-lock", dest="lock_memory", action="store_false")
    add_bus_arguments(parser)
    return parser


def load_program_settings(
    model: type[S], preset_package: str, options: argparse.Namespace, overrides: Sequence[str] = ()
) -> S:
    """Return the settings that the command line asks for; raises SettingsError.

    ``overrides``  further ``table.key=value``, on top of those of ``--set``
    """
    preset = read_preset(preset_package, options.preset) if options.preset else None
    return load_settings(model, preset, options.settings, [*options.overrides, *overrides])


def output_file(text: str) -> Path:
    """Read the name of a file to write after the run; argparse turns the error into one line.

    What is wrong with it is better said now than when there is something to lose.
    """
    path = Path(text)
    if path.is_dir():
        raise argparse.ArgumentTypeError(f"{text} is a directory")
    if not path.parent.is_dir():
        raise argparse.ArgumentTypeError(f"there is no directory {path.parent}")
    if not all(os.access(place, os.W_OK) for place in (path.parent, path) if place.exists()):
        raise argparse.ArgumentTypeError(f"{text} may not be written")
    return path


def recording_file(text: str) -> Path:
    """Read the name of a recording; argparse turns the error into one line."""
    path = output_file(text)
    if obstacle := recording_obstacle(path):
        raise argparse.ArgumentTypeError(obstacle)
    return path


def run_node(
    name: str,
    options: argparse.Namespace,
    settings: Settings,
    make_node: Callable[[int], N],
    conclude: Callable[[N], None] = lambda _node: None,
) -> ExitStatus:
    """Open the bus, run the node to its end in real time, print and write the report.

    ``make_node``  called as ``make_node(start_ns)``, on the monotonic clock [ns]; the first tick is
                   due then, so it must not take long
    ``conclude``   writes and says what the program has to add, after the report

    Returns the exit status: a bus or a recording that fails leaves a report too. Raises BusError
    when the bus cannot be opened, and OSError when a file cannot be written.
    """
    opened = open_bus(options)
    stop = StopRequest()
    # What is to be kept is written before the shut-down, which may take seconds or fail.
    with shutting_down(opened.bus), stop.on_signals():
        recording = _start_recording(options, opened)
        say(name, f"ready on {opened.description}")
        try:
            node, run = _run_in_real_time(options, opened, stop, make_node, recording)
        finally:
            recorded = None if recording is None else recording.close()
        if run.failure:
            say(name, f"error: {run.failure}", sys.stderr)
        report = run_report(
            name, run.ended_by, opened.description, settings, run.loop, node.report()
        )
        report["host"] = run.host
        report["recording"] = None if recorded is None else recorded._asdict()
        if options.report is not None:
            write_json(options.report, report)
        _tell(name, report)
        conclude(node)
    if run.failure:
        return ExitStatus.BUS
    return ExitStatus.OUTPUT if recorded is not None and recorded.failure else ExitStatus.OK


def _start_recording(options: argparse.Namespace, opened: OpenBus) -> Recording | None:
    """Start what was asked for; before the run, whose priority the recorder must not have."""
    if options.record is None:
        return None
    channel = options.channel or getattr(opened.bus, "channel", None) or "can0"
    return Recording(options.record, str(channel).replace(" ", "_"))


def _run_in_real_time(
    options: argparse.Namespace,
    opened: OpenBus,
    stop: StopRequest,
    make_node: Callable[[int], N],
    recording: Recording | None,
) -> tuple[N, _Run]:
    """Make the node and run it to its end."""
    request = RealTimeRequest(options.priority, options.cpu, options.lock_memory)
    failure = ""
    with real_time(request) as answers:
        steal = StealClock()
        start_ns = time.monotonic_ns()
        if options.duration is not None:
            stop.end_at(start_ns + round(options.duration * NS_PER_S))
        node = make_node(start_ns)
        port = BusPort(opened.bus)
        executor = RealTimeExecutor(
            node, port if recording is None else RecordingPort(port, recording)
        )
        try:
            executor.run(stop)
        except BusError as error:
            failure = str(error)
    ended_by = failure or stop.reason or "finished"
    host = host_report(answers, steal.fraction())
    return node, _Run(ended_by, failure, executor.figures, host)


def run_main(name: str, main: Callable[[], int]) -> int:
    """Call ``main``; turns what a user can cause into one line on standard error and a status."""
    try:
        status = main()
        print(end="", flush=True)
        return status
    except SettingsError as error:
        lines, status = str(error).splitlines(), ExitStatus.SETTINGS
    except BusError as error:
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


def _tell(name: str, report: Mapping[str, Any]) -> None:
    """Print in a few lines what the run was like."""
    loop, steal = report["loop"], report["host"]["steal_fraction"]
    lateness = loop["lateness"]
    refused = [f"{a['name']} ({a['detail']})" for a in report["host"]["answers"] if not a["got"]]
    say(name, f"ended by {report['ended_by']} after {loop['duration_s']:.2f} s")
    say(name, f"{loop['frames_received']} frames received, {loop['frames_sent']} sent")
    say(
        name,
        f"lateness p50 {1e3 * lateness['p50_s']:.3f} ms, p99 {1e3 * lateness['p99_s']:.3f} ms, "
        f"max {1e3 * lateness['max_s']:.3f} ms",
    )
    if loop["frames_refused"]:
        say(name, f"{loop['frames_refused']} frames not sent: the bus had no room for them")
    if report["recording"] is not None:
        _tell_recording(name, report["recording"])
    if refused:
        say(name, f"refused by the host: {', '.join(refused)}")
    if steal:
        say(name, f"{100.0 * steal:.1f} % of the processor time went to other guests")


def _tell_recording(name: str, recording: Mapping[str, Any]) -> None:
    """Print what has become of the recording."""
    say(name, f"{recording['frames']} frames recorded in {recording['file']}")
    if recording["dropped"]:
        say(name, f"{recording['dropped']} frames not recorded: the recorder did not keep up")
    if recording["left_out"]:
        say(name, f"{recording['left_out']} frames not recorded: the format has no place for them")
    if recording["failure"]:
        say(name, f"error: {recording['file']}: {recording['failure']}", sys.stderr)


def _seconds(text: str) -> float:
    """Read a duration; argparse turns the error into one line."""
    try:
        value_s = float(text)
    except ValueError:
        value_s = math.nan
    if not 0.0 < value_s < DURATION_S_MAX:
        raise argparse.ArgumentTypeError(f"allowed is above 0 to {DURATION_S_MAX:g}, not {text!r}")
    return value_s
