"""Measure how punctual this machine is, how fast its bus is, and which rate it can keep.

    steer-by-wire probe [-i INTERFACE -c CHANNEL] [--seconds SECONDS] [--json FILE]

Measures twice: as an ordinary program, and with the real-time rights that the host grants. Without
``-i`` the bus is chosen as the programs choose it; if that is the emulated bus and none is running,
the probe starts its own. On the bus it sends only its own requests and echoes, 0x7FE and 0x7FF, a
hundred a second each. docs/real_time.md explains how to read the result.
"""

import argparse
import platform
import sys
from collections.abc import Sequence
from functools import partial

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from steer_by_wire.command_line import command_parser, seconds
from steer_by_wire.runtime.bus import add_bus_arguments
from steer_by_wire.runtime.option_types import add_json_argument
from steer_by_wire.runtime.program import ExitStatus, run_main, say
from steer_by_wire.runtime.program_options import add_real_time_arguments
from steer_by_wire.runtime.report import write_json
from steer_by_wire.tools.probe_host.presentation import record_of, sentences, table_of
from steer_by_wire.tools.probe_host.probe import Probe, probe, steps

NAME = "steer-by-wire probe"
WIDTH_MIN = 95
"""Width of the table, whose figures are no use cut short."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the probe; returns the exit status, which does not depend on the verdict."""
    parser = command_parser(NAME, __doc__, f"{NAME} --json probe.json")
    parser.add_argument(
        "--seconds",
        type=seconds,
        default=1.0,
        help="duration of each measurement (default: %(default)g)",
    )
    add_json_argument(parser)
    add_real_time_arguments(parser)
    add_bus_arguments(parser)
    parser.add_argument(
        "--no-fast-socketcan",
        dest="fast_socketcan",
        action="store_false",
        help="use python-can for SocketCAN too",
    )
    return run_main(NAME, partial(_run, parser.parse_args(arguments)))


def _run(options: argparse.Namespace) -> int:
    result = _probe_with_progress(options)
    console = Console(markup=False, highlight=False)
    console.width = max(console.width, WIDTH_MIN)
    console.print(
        f"bus: {result.bus}\n"
        f"{platform.python_implementation()} {platform.python_version()}, {platform.platform()}",
        soft_wrap=True,
    )
    console.print(table_of(result.measured))
    for sentence in sentences(result):
        console.print(sentence, soft_wrap=True)
    if options.json is not None:
        write_json(options.json, record_of(result))
    return ExitStatus.OK


def _probe_with_progress(options: argparse.Namespace) -> Probe:
    console = Console(stderr=True)
    if not console.is_terminal:
        return probe(options, lambda what: say(NAME, what, sys.stderr))
    columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("opening the bus", total=steps(options))
        begun = False

        def report(what: str) -> None:
            nonlocal begun
            progress.update(task, description=what, advance=int(begun))
            begun = True

        return probe(options, report)


if __name__ == "__main__":
    sys.exit(main())
