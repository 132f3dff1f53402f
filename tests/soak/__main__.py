"""Run the pair as real processes on an emulated bus that a babbling node keeps full.

    python -m tests.soak [--duration-s 600] [--between-s 10] [--starve-s 10] [--out FOLDER]
    python -m tests.soak --rest-bus car.dbc --load 0.5

First the babbling node has the lowest priority: the pair must lose, reorder and miss nothing, the
recorder must have every frame, and memory must not grow. Then its priority lies between those of
two messages of the pair, for each such two: the message of higher priority must not wait behind it.
Then it has the highest: no frame of the pair gets through, which both nodes have to detect. Exit
status: 0 when all of these hold, 1 when not, 3 when a process failed, 4 when a file cannot be
written.
"""

import argparse
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from steer_by_wire.closed_loop.reports.findings import Finding, finding_lines
from steer_by_wire.closed_loop.reports.terminal import plain_console
from steer_by_wire.closed_loop.rest_bus_messages import traffic_of
from steer_by_wire.runtime.command_line import (
    add_out_argument,
    command_parser,
    run_main,
    say,
    seconds,
)
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.program.bus_options import add_traffic_arguments, bus_settings
from steer_by_wire.runtime.program.host import StealClock, priority
from steer_by_wire.runtime.program.report import write_json
from steer_by_wire.runtime.settings import SettingsError
from steer_by_wire.tools.faults.live.live_run import CHANNEL
from tests.soak.babbling_node import (
    GAPS,
    HIGHEST_PRIORITY_IDS,
    LOWEST_PRIORITY_IDS,
)
from tests.soak.findings import (
    SEED,
    between_findings,
    bounds_ns,
    load_findings,
    starve_findings,
)
from tests.soak.soak_run import LiveSoak, SoakSettings, run_live_soak

NAME = "python -m tests.soak"
NOT_SHOWN = 1


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the soak; returns the exit status."""
    parser = command_parser(NAME, __doc__, f"{NAME} --duration-s 60")
    for option, default_s, where in (
        ("--duration-s", 600.0, "with the lowest priority"),
        ("--between-s", 10.0, "between each two messages of the pair"),
        ("--starve-s", 10.0, "with the highest priority"),
    ):
        text = f"babbling {where} (default: %(default)g)"
        parser.add_argument(option, type=seconds, default=default_s, metavar="S", help=text)
    parser.add_argument(
        "--priority",
        type=priority,
        default=50,
        metavar="0..99",
        help="SCHED_FIFO priority, if the host grants it (default: %(default)s)",
    )
    add_traffic_arguments(parser)
    add_out_argument(parser, "out/soak", "folder for logs and figures; 12 MB a minute")
    return run_main(NAME, partial(_run, parser.parse_args(arguments)))


def _run(options: argparse.Namespace) -> int:
    os.environ["PYTHONPATH"] = str(Path(__file__).parents[2])  # where the babbling node is found
    console = plain_console()
    bus = bus_settings(options)
    if bus.has_errors:
        raise SettingsError(f"{options.bus_settings}: the soak demands a bus without errors")
    traffic_of(bus, SEED)  # a mistake in it is one of the command line
    soak_of = partial(SoakSettings, bus=bus, priority=options.priority)
    parts: dict[str, tuple[SoakSettings, Callable[[LiveSoak], Iterator[Finding]]]] = {
        "load": (soak_of(LOWEST_PRIORITY_IDS, options.duration_s), load_findings),
        **{
            f"between-{gap[0]:03X}": (soak_of(tuple(gap[:4]), options.between_s), between_findings)
            for gap in GAPS
        },
        "starve": (soak_of(HIGHEST_PRIORITY_IDS, options.starve_s), starve_findings),
    }
    records, holds, steal = {}, True, StealClock()
    begin_s = time.monotonic()
    for name, (soak, judge) in parts.items():
        run = run_live_soak(soak, options.out / name, partial(say, NAME, stream=sys.stderr))
        findings = list(judge(run))
        holds = holds and all(finding.holds for finding in findings)
        records[name] = record_of(run, findings)
        title = f"babbling with {soak.name} for {soak.babble_s:g} s"
        console.print(title, *finding_lines(findings), "", sep="\n")
    stolen = steal.fraction()
    write_json(
        options.out / "figures.json",
        {"duration_s": time.monotonic() - begin_s, "steal_fraction": stolen, **records},
    )
    if stolen:
        console.print(f"{100 * stolen:.1f} % of the processor time went to other guests")
    return ExitStatus.OK if holds else NOT_SHOWN


def record_of(run: LiveSoak, findings: Sequence[Finding]) -> dict[str, Any]:
    """Return all figures of one run for JSON."""
    bus = run.bus._asdict()
    bus["control"] = {f"{can_id:03X}": len(frames) for can_id, frames in run.bus.control.items()}
    return {
        "settings": {
            **run.settings._asdict(),
            "bus": run.settings.bus.model_dump(mode="json"),
        },
        "findings": [finding._asdict() for finding in findings],
        "bus": bus,
        "messages": list(_rows(run)),
        "modes": run.modes,
        "memory": {name: figures._asdict() for name, figures in run.memory.items()},
        "memory_samples": dict(run.memory_samples),
        "reports": dict(run.reports),
    }


def _rows(run: LiveSoak) -> Iterator[dict[str, Any]]:
    delays = run.reports["broker"]["channels"][CHANNEL]["arbitration_delay"]
    bounds = bounds_ns(run)
    for message in run.messages:
        arbitration = dict(delays[f"{message.can_id:03X}"])
        bound_ns = bounds.get(message.can_id)
        arbitration["bound_s"] = None if bound_ns is None else bound_ns * 1e-9
        waited = message.waited
        yield {
            **{key: value for key, value in message._asdict().items() if key != "waited"},
            "arbitration": arbitration,
            "handed_over": {
                "p50_s": waited.p50_ns * 1e-9,
                "p99_s": waited.p99_ns * 1e-9,
                "max_s": waited.max_ns * 1e-9,
            },
        }


if __name__ == "__main__":
    sys.exit(main())
