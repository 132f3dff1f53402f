"""What the two programs share: command line, start, signals, report, exit status."""

import argparse
import math
import signal
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from enum import IntEnum
from pathlib import Path
from types import FrameType
from typing import Any, Protocol, TypeVar

from runtime.bus import BusError, BusPort, add_bus_arguments, open_bus
from runtime.host import (
    RealTimeRequest,
    StealClock,
    real_time,
)
from runtime.node import Node
from runtime.real_time import RealTimeExecutor
from runtime.report import host_report, run_report, write_json
from runtime.settings import (
    Settings,
    SettingsError,
    load_settings,
    preset_names,
    read_preset,
)

NS_PER_S = 1_000_000_000
DURATION_S_MAX = 1e9


class ExitStatus(IntEnum):
    """Why a program has ended, for the shell."""

    OK = 0
    SETTINGS = 2
    BUS = 3
    INTERRUPTED = 130
    """By Ctrl-C before there was a run; a run that is interrupted ends with OK and its report."""


class ReportingNode(Node, Protocol):
    """A node that can say what it has seen."""

    def report(self) -> Mapping[str, Any]:
        """Figures of the run so far; numbers, texts, and mappings of them."""
        ...


N = TypeVar("N", bound=ReportingNode)
S = TypeVar("S", bound=Settings)


class StopRequest:
    """Becomes true when the run is to end, and remembers why."""

    def __init__(
        self,
        start_ns: int,
        duration_s: float | None,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._end_ns = None if duration_s is None else start_ns + round(duration_s * NS_PER_S)
        self._clock_ns = clock_ns
        self.reason = ""

    def __call__(self) -> bool:
        """Whether the run is to end."""
        if not self.reason and self._end_ns is not None and self._clock_ns() >= self._end_ns:
            self.reason = "duration"
        return bool(self.reason)

    @contextmanager
    def on_signals(self) -> Iterator[None]:
        """Let SIGINT and SIGTERM ask for the end until the end of the block."""
        previous = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
        for number in previous:
            signal.signal(number, self._take_signal)
        try:
            yield
        finally:
            for number, handler in previous.items():
                signal.signal(number, handler)

    def _take_signal(self, number: int, _frame: FrameType | None) -> None:
        self.reason = signal.Signals(number).name


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
    parser.add_argument("--report", type=Path, metavar="FILE", help="write a report, JSON")
    parser.add_argument(
        "--duration", type=_seconds, metavar="SECONDS", help="end after this time at the latest"
    )
    group = parser.add_argument_group("real time, as far as the host grants it")
    group.add_argument(
        "--priority",
        type=int,
        default=50,
        choices=range(100),
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


def run_node(
    name: str, options: argparse.Namespace, settings: Settings, make_node: Callable[[int], N]
) -> tuple[N, ExitStatus]:
    """Open the bus, run the node to its end in real time, print and write the report.

    ``make_node``  called as ``make_node(start_ns)``, on the monotonic clock [ns]; the first tick is
                   due then, so it must not take long

    Returns the node, for what it has recorded, and the exit status: a bus that fails ends the run
    with a report too. Raises BusError when the bus cannot be opened, and OSError when the report
    cannot be written.
    """
    opened = open_bus(options)
    try:
        print(f"{name}: ready on {opened.description}", flush=True)
        request = RealTimeRequest(options.priority, options.cpu, options.lock_memory)
        failure = ""
        with real_time(request) as answers:
            steal = StealClock()
            start_ns = time.monotonic_ns()
            stop = StopRequest(start_ns, options.duration)
            node = make_node(start_ns)
            executor = RealTimeExecutor(node, BusPort(opened.bus))
            with stop.on_signals():
                try:
                    executor.run(stop)
                except BusError as error:
                    failure = str(error)
        ended_by = failure or stop.reason or "finished"
        report = run_report(
            name, ended_by, opened.description, settings, executor.figures, node.report()
        )
        report["host"] = host_report(answers, steal.fraction())
    finally:
        opened.bus.shutdown()
    _tell(name, report)
    if failure:
        print(f"{name}: error: {failure}", file=sys.stderr)
    if options.report is not None:
        write_json(options.report, report)
    return node, ExitStatus.BUS if failure else ExitStatus.OK


def run_main(name: str, main: Callable[[], int]) -> int:
    """Call ``main``; turns what a user can cause into one line on standard error and a status."""
    try:
        return main()
    except (SettingsError, argparse.ArgumentError) as error:
        lines, status = str(error).splitlines(), ExitStatus.SETTINGS
    except BusError as error:
        lines, status = [str(error)], ExitStatus.BUS
    except OSError as error:
        lines, status = [f"{error.filename}: {error.strerror}"], ExitStatus.SETTINGS
    except KeyboardInterrupt:
        lines, status = ["interrupted before the run"], ExitStatus.INTERRUPTED
    for line in lines:
        print(f"{name}: error: {line}", file=sys.stderr)
    return status


def _tell(name: str, report: Mapping[str, Any]) -> None:
    """Print in a few lines what the run was like."""
    loop, steal = report["loop"], report["host"]["steal_fraction"]
    lateness = loop["lateness"]
    refused = [f"{a['name']} ({a['detail']})" for a in report["host"]["answers"] if not a["got"]]
    print(f"{name}: ended by {report['ended_by']} after {loop['duration_s']:.2f} s")
    print(
        f"{name}: {loop['frames_received']} frames received, {loop['frames_sent']} sent; lateness "
        f"p50 {1e3 * lateness['p50_s']:.3f} ms, p99 {1e3 * lateness['p99_s']:.3f} ms, "
        f"max {1e3 * lateness['max_s']:.3f} ms"
    )
    if refused:
        print(f"{name}: refused by the host: {', '.join(refused)}")
    if steal:
        print(f"{name}: {100.0 * steal:.1f} % of the processor time went to other guests")


def _seconds(text: str) -> float:
    """Read a duration; argparse turns the error into one line."""
    try:
        value_s = float(text)
    except ValueError:
        value_s = math.nan
    if not 0.0 < value_s < DURATION_S_MAX:
        raise argparse.ArgumentTypeError(f"allowed is above 0 to {DURATION_S_MAX:g}, not {text!r}")
    return value_s
