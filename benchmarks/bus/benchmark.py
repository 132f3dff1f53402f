"""Times how fast and punctually the controller answers on a CAN bus, beside C and bare Python.

    tools/with_vcan python -m benchmarks bus
    python -m benchmarks bus --no-can

Everything compared runs in turns on the same machine within minutes, or at once; each figure is the
median of several repetitions, each ratio is within one repetition. docs/real_time.md explains what
is measured and why.
"""

import argparse
import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from benchmarks.bus.allocations import tick_memory
from benchmarks.bus.lines import answer_lines, memory_lines, parts, skipped_lines, tick_lines
from benchmarks.bus.processes import PRIORITY_MAX, PRIORITY_MIN, compile_all, may_have_priority
from benchmarks.bus.runs import (
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
from benchmarks.measurement import Line, Measured
from steer_by_wire.closed_loop.processes.process_group import launched_broker
from steer_by_wire.runtime.command_line import seconds, whole_number
from steer_by_wire.runtime.exit_status import BusError
from steer_by_wire.runtime.port.interface_choice import socketcan_obstacle

CHANNEL = "benchmark_bus"
"""Channel of the emulated bus."""
ANSWERING = (C_ECHO, BARE_PYTHON, PYTHON_WITH_TIMEOUT, NODE)
RATE_HZ, LONG_RATE_HZ = 100, 1000
PARTS = 5
"""Parts of the long run, as repetitions of its lateness."""
MEMORY_TICKS = 5000
BETWEEN_S = 2.0
"""Time to start a run, for the progress bar."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("-c", "--channel", default="vcan0", help="default: %(default)s")
    parser.add_argument(
        "--no-can",
        action="store_true",
        help="only lateness and skipped ticks, on an emulated bus; needs no SocketCAN",
    )
    parser.add_argument(
        "--duration",
        type=seconds,
        default=4.0,
        help="duration of each short run (default: %(default)g)",
    )
    parser.add_argument(
        "--repetitions", type=whole_number(1, 1000), default=5, help="default: %(default)s"
    )
    parser.add_argument(
        "--long-duration",
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


def measure(options: argparse.Namespace) -> Measured:
    """Run all programs; without CAN only lateness and skipped ticks."""
    obstacle = "" if options.no_can else socketcan_obstacle(options.channel)
    if obstacle:
        raise BusError(
            f"{obstacle}; this brings one: tools/with_vcan python -m benchmarks bus; "
            "--no-can measures what can be measured without"
        )
    granted = bool(options.priority) and may_have_priority()
    with tempfile.TemporaryDirectory(prefix="bus-benchmark-") as name, _bus(options) as bus:
        folder = Path(name)
        bench = Bench(*bus, folder, compile_all(folder), options.priority if granted else 0)
        write_frames(bench.frames)
        lines = _lines(*_run_all(bench, options))
    note = f"SCHED_FIFO {bench.priority}" if granted else "ordinary priority"
    if options.priority and not granted:
        note += ", SCHED_FIFO refused by the host"
    return Measured(lines, [note], {"sched_fifo": bench.priority})


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
    short_s, long_s = options.duration + BETWEEN_S, options.long_duration + BETWEEN_S
    columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        total_s = options.repetitions * (len(answered) + 1) * short_s + long_s
        task = progress.add_task("", total=total_s)
        for _ in range(options.repetitions):
            for who in answered:
                progress.update(task, description=who)
                answered[who].append(answer_run(bench, who, RATE_HZ, options.duration))
                progress.advance(task, short_s)
            progress.update(task, description=f"lateness at {RATE_HZ} Hz")
            ticks.append(tick_run(bench, RATE_HZ, options.duration))
            progress.advance(task, short_s)
        progress.update(task, description=f"{options.long_duration:g} s at {LONG_RATE_HZ} Hz")
        long = tick_run(bench, LONG_RATE_HZ, options.long_duration)
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


def _priority(text: str) -> int:
    """Read a priority that leaves room above and below."""
    allowed = (0, *range(PRIORITY_MIN, PRIORITY_MAX + 1))
    if not (text.isascii() and text.isdecimal() and int(text) in allowed):
        raise argparse.ArgumentTypeError(
            f"allowed is 0 or {PRIORITY_MIN} to {PRIORITY_MAX}, not {text!r}"
        )
    return int(text)
