"""Measures how fast the programs are on this machine, against the targets.

    python -m benchmarks loop [--against SAVED]   control steps, frames, virtual time, programs
    python -m benchmarks batch                    compiled runs
    python -m benchmarks bus [--no-can]           the controller on a bus, beside C and bare Python

Prints the median of several repetitions with the least and the most, and the target where there is
one. A wide spread means that other programs used the machine; a missed target then means little.
"""

import argparse
import os
import platform
import sys
from collections.abc import Sequence
from functools import partial

from rich.console import Console

from benchmarks import batch, loop
from benchmarks.bus import benchmark as bus
from benchmarks.measurement import line_record, lines_table
from steer_by_wire.runtime.command_line import add_subcommand, command_parser, output_file, run_main
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.program.priority_and_memory_lock import StealClock
from steer_by_wire.runtime.program.report import write_json

NAME = "python -m benchmarks"
EXAMPLE = f"{NAME} loop --json before.json\n{NAME} loop --against before.json"
WIDTH_MIN = 110
"""Width of the table, whose figures are no use cut short."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one benchmark; returns the exit status, which does not depend on the figures."""
    parser = command_parser(NAME, __doc__, EXAMPLE, "loop|batch|bus ...")
    parsers = parser.add_subparsers(prog=NAME, dest="benchmark", required=True, metavar="")
    for name, module in (("loop", loop), ("batch", batch), ("bus", bus)):
        added = add_subcommand(parsers, name, module.__doc__, f"{NAME} {name}")
        module.add_arguments(added)
        added.add_argument(
            "--json", type=output_file, metavar="FILE", help="also write the figures to a file"
        )
        added.set_defaults(measure=module.measure)
    return run_main(NAME, partial(_run, parser.parse_args(arguments)))


def _run(options: argparse.Namespace) -> int:
    console, steal = Console(markup=False, highlight=False), StealClock()
    console.width = max(console.width, WIDTH_MIN)
    measured = options.measure(options)
    machine = {
        "python": f"{platform.python_implementation()} {platform.python_version()}",
        "platform": platform.platform(),
        "processors": os.cpu_count(),
        "vcan_backend": os.environ.get("WITH_VCAN_BACKEND"),
        "steal_fraction": steal.fraction(),
    }
    console.print(lines_table(measured.lines, measured.calibration_us))
    for note in measured.notes:
        console.print(note, soft_wrap=True)
    stolen = machine["steal_fraction"]
    steal_text = "steal unknown" if stolen is None else f"{100 * stolen:.1f} % stolen by the host"
    if machine["vcan_backend"] == "uml":
        steal_text = "what the host took cannot be seen in User Mode Linux"
    console.print(f"{machine['python']}, {machine['processors']} processors, {steal_text}")
    if options.json is not None:
        records = [line_record(line, measured.calibration_us) for line in measured.lines]
        write_json(options.json, {"machine": machine, "lines": records, **measured.record})
    return ExitStatus.OK


if __name__ == "__main__":
    sys.exit(main())
