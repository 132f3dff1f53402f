"""Measures how much badly behaved clients of the emulated bus disturb a well-behaved one.

    python -m steer_by_wire.tools.faults.live.vandals [--seconds 15] [--json FILE]

A good client sends a frame of high priority every few milliseconds, and another one receives it. At
the same time no other client runs, or one vandal of each kind in turn, or one of each at once.
"""

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import can
from rich.console import Console
from rich.table import Table

from ....closed_loop.processes import Processes
from ....closed_loop.reports.terminal import plain_table
from ....runtime.command_line import command_parser, seconds
from ....runtime.frame.message import message_of
from ....runtime.node import NS_PER_S
from ....runtime.node.statistics import DurationStatistics, DurationSummary
from ....runtime.program.host import RealTimeRequest, StealClock, real_time
from ....runtime.program.option_types import output_file, priority
from ....runtime.program.program import ExitStatus, run_main
from ....runtime.program.report import write_json
from ..injection.babbling_node import babble
from .pair_on_bus import resident_kib
from .vandal import KINDS

NAME = "vandals"
CHANNEL, GOOD_ID = "can0", 0x010
PERIOD_S, PATIENCE_S = 0.004, 5.0
NOBODY, ALL = "nobody", "all at once"
WIDTH = 110


class Cost(NamedTuple):
    """What was measured beside vandals.

    ``delay``        from sending a frame to receiving it at the other end
    ``lost``         frames that did not arrive
    ``processor``    share of one processor that the broker used
    ``memory_kib``   most that the broker held [KiB]
    ``broker``       its report
    """

    vandals: str
    delay: DurationSummary
    lost: int
    processor: float
    memory_kib: int
    broker: dict[str, Any]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the measurement; returns the exit status."""
    parser = command_parser(NAME, __doc__, "python -m steer_by_wire.tools.faults.live.vandals")
    parser.add_argument("--seconds", type=seconds, default=15.0, help="of each (default: 15)")
    parser.add_argument("--priority", type=priority, default=50, metavar="0..99")
    parser.add_argument("--json", type=output_file, metavar="FILE", help="write the figures too")
    return run_main(NAME, partial(_run, parser.parse_args(arguments)))


def _run(options: argparse.Namespace) -> int:
    groups = {NOBODY: (), **{kind: (kind,) for kind in KINDS}, ALL: tuple(KINDS)}
    steal, costs = StealClock(), []
    for name, kinds in groups.items():
        print(f"{NAME}: {name}", file=sys.stderr, flush=True)
        costs.append(measure(name, kinds, options.seconds, options.priority))
    console = Console(markup=False, highlight=False, width=WIDTH)
    console.print(_table(costs))
    if stolen := steal.fraction():
        console.print(f"{100 * stolen:.1f} % of the processor time went to other guests")
    if options.json is not None:
        write_json(options.json, {"costs": [cost._asdict() for cost in costs]})
    return ExitStatus.OK


def measure(name: str, kinds: Sequence[str], duration_s: float, level: int) -> Cost:
    """Run a broker, two good clients and vandals of ``kinds``; raises ProcessError."""
    with (
        tempfile.TemporaryDirectory(prefix="vandals-") as folder,
        Processes(Path(folder), Path(folder)) as programs,
    ):
        programs.start_broker(Path(folder) / "socket", ["--priority", str(level)])
        broker = programs.pids()["broker"]
        filters: Any = [{"can_id": GOOD_ID, "can_mask": 0x7FF, "extended": False}]
        joined = partial(can.Bus, CHANNEL, interface="emulated", address=programs.address)
        with joined(can_filters=filters) as sender, joined(can_filters=filters) as listener:
            for kind in kinds:
                arguments = [kind, programs.address, CHANNEL]
                programs.start(kind, "steer_by_wire.tools.faults.live.vandal", arguments)
            before_s, begin_s = _processor_s(broker), time.monotonic()
            with real_time(RealTimeRequest(level // 2)):
                delay, lost, memory_kib = _exchange(sender, listener, duration_s, broker)
            share = (_processor_s(broker) - before_s) / (time.monotonic() - begin_s)
            programs.kill(kinds)
        return Cost(name, delay, lost, share, memory_kib, programs.stop("broker"))


def _exchange(
    sender: can.BusABC, listener: can.BusABC, duration_s: float, broker: int
) -> tuple[DurationSummary, int, int]:
    delays, lost, most_kib = DurationStatistics(), 0, 0
    for number in range(round(duration_s / PERIOD_S)):
        begin_ns = time.monotonic_ns()
        sender.send(message_of(babble(GOOD_ID, number)))
        received = listener.recv(PATIENCE_S)
        if received is None:
            lost += 1
            continue
        lost += int.from_bytes(received.data, "little") != number
        delays.record(time.monotonic_ns() - begin_ns)
        if number % 50 == 0:
            most_kib = max(most_kib, resident_kib(broker) or 0)
        time.sleep(PERIOD_S)
    return delays.summary(), lost, most_kib


def _processor_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def _table(costs: Sequence[Cost]) -> Table:
    headings = ("p50", "p99", "max", "lost", "broker", "KiB", "load")
    title = "a frame of high priority, from sending to having it [ms]"
    table = plain_table(["beside"], headings, title)
    table.add_column("thrown out, held back")
    for cost in costs:
        clients = cost.broker["clients"]
        gone = {c: n for c, n in clients["disconnected"].items() if n and c != "left"}
        parts = [f"{count} {cause}" for cause, count in gone.items()]
        if clients["held_back"]:
            parts.append(f"held back {clients['held_back']}x")
        discarded = cost.broker["channels"][CHANNEL]["discarded"]
        table.add_row(
            cost.vandals,
            *(f"{ns / (NS_PER_S / 1000):.2f}" for ns in cost.delay[2:]),
            str(cost.lost),
            f"{100 * cost.processor:.0f} %",
            str(cost.memory_kib),
            f"{100 * cost.broker['channels'][CHANNEL]['load']:.0f} %",
            ", ".join([*parts, *[f"{discarded} frames discarded"] * bool(discarded)]),
        )
    return table


if __name__ == "__main__":
    sys.exit(main())
