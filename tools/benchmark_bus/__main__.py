"""Measure how fast and punctually the controller answers on a CAN bus, against C and bare Python.

    steer-by-wire with-vcan steer-by-wire benchmark-bus [--json FILE]
    steer-by-wire benchmark-bus --no-can

Everything compared runs in turns on the same machine within minutes, or at once; each figure is the
median of several repetitions, each ratio is within one repetition. docs/real_time.md explains what
is measured and why.
"""

import argparse
import os
import platform
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from steer_by_wire.closed_loop.processes import launched_broker
from steer_by_wire.runtime.command_line import command_parser, seconds, whole_number
from steer_by_wire.runtime.port.python_can import BusError, socketcan_obstacle
from steer_by_wire.runtime.program.host import StealClock
from steer_by_wire.runtime.program.option_types import add_json_argument
from steer_by_wire.runtime.program.program import ExitStatus, run_main
from steer_by_wire.runtime.program.report import write_json
from steer_by_wire.tools.benchmark_bus.allocations import tick_memory
from steer_by_wire.tools.benchmark_bus.lines import (
    answer_lines,
    memory_lines,
    parts,
    skipped_lines,
    tick_lines,
)
from steer_by_wire.tools.benchmark_bus.processes import (
    PRIORITY_MAX,
    PRIORITY_MIN,
    compile_all,
    may_have_priority,
)
from steer_by_wire.tools.benchmark_bus.runs import (
    BARE_PYTHON,
    C_ECHO,
    NODE,
    PRESET,
    PYTHON_WITH_TIMEOUT,
    AnswerRun,
    Bench,
    TickRun,
    answer_run,
    socketcan_options,
    tick_run,
    write_frames,
)
from steer_by_wire.tools.benchmarking.measurement import Line, line_record, lines_table, steal_text

NAME = "steer-by-wire benchmark-bus"
CHANNEL = "benchmark_bus"
"""Channel of the emulated bus."""
ANSWERING = (C_ECHO, BARE_PYTHON, PYTHON_WITH_TIMEOUT, NODE)
RATE_HZ, LONG_RATE_HZ = 100, 1000
PARTS = 5
"""Parts of the long run, as repetitions of its lateness."""
MEMORY_TICKS = 5000
WIDTH_MIN = 110
"""Width of the table, whose figures are no use cut short."""
BETWEEN_S = 2.0
"""Time to start a run, for the progress bar."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark; returns the exit status, which does not depend on the figures."""
    parser = command_parser(NAME, __doc__, f"{NAME} --no-can --long-seconds 10")
    parser.add_argument("-c", "--channel", default="vcan0", help="default: %(default)s")
    parser.add_argument(
        "--no-can",
        action="store_true",
        help="only lateness and skipped ticks, on an emulated bus; needs no SocketCAN",
    )
    parser.add_argument(
        "--seconds",
        type=seconds,
        default=4.0,
        help="duration of each short run (default: %(default)g)",
    )
    parser.add_argument(
        "--repetitions", type=whole_number(1, 1000), default=5, help="default: %(default)s"
    )
    parser.add_argument(
        "--long-seconds",
        type=seconds,
        default=60.0,
        metavar="SECONDS",
        help=f"duration of the run at {LONG_RATE_HZ} Hz (default: %(default)g)",
    )
    parser.add_argument(
        "--priority",
        type=_priority,
        default=50,
        metavar=f"0|{PRIORITY_MIN}..{PRIORITY_MAX}",
        help="SCHED_FIFO priority of all programs; 0: none (default: %(default)s)",
    )
    add_json_argument(parser)
    return run_main(NAME, partial(_benchmark, parser.parse_args(arguments)))


def _benchmark(options: argparse.Namespace) -> int:
    obstacle = "" if options.no_can else socketcan_obstacle(options.channel)
    if obstacle:
        raise BusError(
            f"{obstacle}; this brings one: steer-by-wire with-vcan steer-by-wire benchmark-bus; "
            "--no-can measures what can be measured without"
        )
    console, steal = Console(markup=False, highlight=False), StealClock()
    granted = bool(options.priority) and may_have_priority()
    with tempfile.TemporaryDirectory(prefix="bus-benchmark-") as name, _bus(options) as bus:
        folder = Path(name)
        priority = options.priority if granted else 0
        bench = Bench(*bus, folder, compile_all(folder), priority)
        write_frames(bench.frames)
        lines = _lines(*_run_all(bench, options))
    machine = {
        "python": f"{platform.python_implementation()} {platform.python_version()}",
        "platform": platform.platform(),
        "vcan_backend": os.environ.get("WITH_VCAN_BACKEND"),
        "processors": os.cpu_count(),
        "sched_fifo": bench.priority,
        "steal_fraction": steal.fraction(),
    }
    console.width = max(console.width, WIDTH_MIN)
    console.print(lines_table(lines))
    for line in _machine_lines(machine, refused=bool(options.priority) and not granted):
        console.print(line, soft_wrap=True)
    if options.json is not None:
        write_json(options.json, {"machine": machine, "lines": [*map(line_record, lines)]})
    return ExitStatus.OK


@contextmanager
def _bus(options: argparse.Namespace) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Yield the SocketCAN channel, if any, and the options with which a program joins the bus."""
    if not options.no_can:
        yield options.channel, socketcan_options(options.channel)
        return
    with (
        open(os.devnull, "w", encoding="utf-8") as nowhere,
        launched_broker(log=nowhere) as address,
    ):
        yield "", ("-i", "emulated", "-c", CHANNEL, "--bus-kwargs", f"address={address}")


def _run_all(
    bench: Bench, options: argparse.Namespace
) -> tuple[Mapping[str, list[AnswerRun]], list[TickRun], TickRun]:
    """Run everything, in turns, so that other work on the machine affects all alike.

    Returns the runs of those that answer, none without CAN, those at the rate, and the long one.
    """
    answered: dict[str, list[AnswerRun]] = {who: [] for who in ANSWERING if bench.channel}
    ticks = []
    short_s, long_s = options.seconds + BETWEEN_S, options.long_seconds + BETWEEN_S
    columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        total_s = options.repetitions * (len(answered) + 1) * short_s + long_s
        task = progress.add_task("", total=total_s)
        for _ in range(options.repetitions):
            for who in answered:
                progress.update(task, description=who)
                answered[who].append(answer_run(bench, who, RATE_HZ, options.seconds))
                progress.advance(task, short_s)
            progress.update(task, description=f"lateness at {RATE_HZ} Hz")
            ticks.append(tick_run(bench, RATE_HZ, options.seconds))
            progress.advance(task, short_s)
        progress.update(task, description=f"{options.long_seconds:g} s at {LONG_RATE_HZ} Hz")
        long = tick_run(bench, LONG_RATE_HZ, options.long_seconds)
    return answered, ticks, long


def _lines(
    answers: Mapping[str, list[AnswerRun]], ticks: list[TickRun], long: TickRun
) -> list[Line]:
    reports = [run.report["node"] for run in (*ticks, long)]
    reports += [run.report["node"] for run in answers.get(NODE, []) if run.report is not None]
    return [
        *(answer_lines(answers) if answers else []),
        *tick_lines(ticks),
        *tick_lines(parts(long, PARTS)),
        *skipped_lines(long),
        *memory_lines(tick_memory(PRESET, MEMORY_TICKS), reports),
    ]


def _machine_lines(machine: Mapping[str, Any], *, refused: bool) -> list[str]:
    stolen, priority = machine["steal_fraction"], machine["sched_fifo"]
    backend = machine["vcan_backend"]
    unseen = "what the host took cannot be seen in User Mode Linux"
    steal = unseen if backend == "uml" else steal_text(stolen)
    fifo = f"SCHED_FIFO {priority}" if priority else "ordinary priority"
    return [
        f"{machine['python']}, {machine['processors']} processors, {steal}",
        f"{fifo}{', SCHED_FIFO refused by the host' if refused else ''}"
        f"{f'; with_vcan: {backend}' if backend else ''}",
    ]


def _priority(text: str) -> int:
    """Read a priority that leaves room above and below."""
    allowed = (0, *range(PRIORITY_MIN, PRIORITY_MAX + 1))
    if not (text.isascii() and text.isdecimal() and int(text) in allowed):
        raise argparse.ArgumentTypeError(
            f"allowed is 0 or {PRIORITY_MIN} to {PRIORITY_MAX}, not {text!r}"
        )
    return int(text)


if __name__ == "__main__":
    sys.exit(main())
