"""Measure how fast the programs are on this machine, against the targets.

    steer-by-wire benchmark [--json FILE] [--against SAVED]

Prints the median of several repetitions with the least and the most, the target where there is one,
and the ratio of the time behind each figure to that of a fixed loop of arithmetic. A start is timed
to the program's first frame on an emulated bus. A wide spread means that other programs used the
machine; a missed target then means little. ``--against`` lists what has become slower since a file
written by ``--json``.
"""

import argparse
import os
import platform
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from rich.console import Console

from steer_by_wire.benchmarking.measurement import calibration
from steer_by_wire.benchmarking.table import line_record, lines_table, steal_text
from steer_by_wire.command_line import command_parser
from steer_by_wire.runtime.host import StealClock
from steer_by_wire.runtime.option_types import add_json_argument
from steer_by_wire.runtime.program import ExitStatus, run_main
from steer_by_wire.runtime.report import write_json
from steer_by_wire.tools.benchmark.comparison import comparison_text, ratios_of, read_ratios
from steer_by_wire.tools.benchmark.loop import (
    controller_node_line,
    frame_lines,
    law_lines,
    virtual_time_lines,
)
from steer_by_wire.tools.benchmark.startup import heavy_modules, startup_lines

NAME = "steer-by-wire benchmark"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run all benchmarks; returns the exit status, which does not depend on the figures."""
    parser = command_parser(
        NAME, __doc__, f"{NAME} --json before.json\n{NAME} --against before.json"
    )
    add_json_argument(parser)
    parser.add_argument(
        "--against", type=Path, metavar="SAVED", help="list what is slower than in a saved file"
    )
    options = parser.parse_args(arguments)
    return run_main(NAME, partial(_run, options))


def _run(options: argparse.Namespace) -> int:
    before = None if options.against is None else read_ratios(options.against)
    now = _benchmark(options.json)
    if before is not None:
        print(comparison_text(before, now))
    return ExitStatus.OK


def _benchmark(json_file: Path | None) -> dict[str, float]:
    console, steal = Console(), StealClock()
    loop = calibration()
    lines = [
        *law_lines(),
        *frame_lines(),
        controller_node_line(),
        *virtual_time_lines(),
        *startup_lines(),
    ]
    heavy, stolen = heavy_modules(), steal.fraction()
    machine = {
        "python": f"{platform.python_implementation()} {platform.python_version()}",
        "platform": platform.platform(),
        "processors": os.cpu_count(),
        "steal_fraction": stolen,
    }
    console.print(lines_table([loop, *lines], loop.median))
    for program, modules in heavy.items():
        console.print(f"heavy modules {program} imports (target: none): {_listed(modules)}")
    console.print(f"{machine['python']}, {machine['processors']} processors, ", end="")
    console.print(steal_text(stolen))
    records = [
        {**line_record(line), "ratio_to_calibration": line.ratio(loop.median)} for line in lines
    ]
    if json_file is not None:
        content = {"machine": machine, "calibration_us": loop.median, "lines": records}
        write_json(json_file, content | {"heavy_modules": heavy})
    return ratios_of(records)


def _listed(names: Sequence[str]) -> str:
    return ", ".join(names) or "none"


if __name__ == "__main__":
    sys.exit(main())
