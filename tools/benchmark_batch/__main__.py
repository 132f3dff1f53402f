"""Measure how fast compiled runs are, compared with C, threads, a cold start and other tools.

    steer-by-wire benchmark-batch [--json FILE] [--chart FILE.png]

Everything compared is timed in turn in one process; the results are medians. The C program does the
same arithmetic; a result that differs in any bit is an error.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from functools import partial
from typing import Any

from matplotlib.figure import Figure
from rich.console import Console

from steer_by_wire.runtime.command_line import command_parser
from steer_by_wire.runtime.program.host import StealClock
from steer_by_wire.runtime.program.option_types import add_json_argument, output_file
from steer_by_wire.runtime.program.program import ExitStatus, run_main
from steer_by_wire.runtime.program.report import write_json
from steer_by_wire.tools.benchmark_batch.comparison import (
    line_of_threads,
    lines_beside_c,
    lines_beside_others,
    seconds_of_runs,
)
from steer_by_wire.tools.benchmarking.measurement import (
    Line,
    Target,
    line_record,
    lines_table,
    steal_text,
)

NAME = "steer-by-wire benchmark-batch"
COUNTS = (10, 30, 100, 300, 1000)
LENGTHS_S = (10.0, 30.0, 100.0, 300.0, 1000.0)
STARTS = 5
_FIRST_RESULT = """
from steer_by_wire.closed_loop.compiled.engine import run_batch
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.plant_emulator.settings import plant_preset
run_batch(plant_preset("paper_corner_d"), controller_preset("practical_pd_ddob"))
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark; returns the exit status, which does not depend on the figures."""
    parser = command_parser(NAME, __doc__, f"{NAME} --chart batch.png")
    add_json_argument(parser)
    parser.add_argument(
        "--chart",
        type=output_file,
        metavar="FILE.png",
        help="plot of the time over the number of runs",
    )
    options = parser.parse_args(arguments)
    return run_main(NAME, partial(_run, options))


def _run(options: argparse.Namespace) -> int:
    console, steal = Console(), StealClock()
    with console.status("compiled runs beside C"):
        lines = lines_beside_c()
    with console.status("threads"):
        lines.append(line_of_threads())
    with console.status("cold and warm starts"):
        lines += start_lines()
    with console.status("other tools"):
        lines += lines_beside_others()
    seconds = seconds_of_runs(COUNTS, LENGTHS_S)
    console.print(lines_table(lines))
    stolen = steal.fraction()
    console.print(steal_text(stolen))
    if options.json is not None:
        records = [line_record(line) for line in lines]
        content: dict[str, Any] = {"lines": records, "runs": COUNTS, "lengths_s": LENGTHS_S}
        content |= {**seconds, "steal_fraction": stolen}
        write_json(options.json, content)
    if options.chart is not None:
        draw_chart(seconds).savefig(options.chart, dpi=100)
    return ExitStatus.OK


def start_lines() -> list[Line]:
    """Time a new process up to its first result, without and with a cache on disk."""
    cold, warm = [], []
    for _ in range(STARTS):
        with tempfile.TemporaryDirectory() as cache:
            cold.append(_first_result_s(cache))
            warm.append(_first_result_s(cache))
    return [
        Line("import to first result, cold", "s", cold, [1e6 * s for s in cold], Target(True, 5.0)),
        Line("import to first result, warm", "s", warm, [1e6 * s for s in warm], Target(True, 1.5)),
    ]


def _first_result_s(cache: str) -> float:
    begin_s = time.perf_counter()
    environment = {**os.environ, "XDG_CACHE_HOME": cache}
    subprocess.run((sys.executable, "-P", "-c", _FIRST_RESULT), check=True, env=environment)
    return time.perf_counter() - begin_s


def draw_chart(seconds: dict[str, list[float]]) -> Figure:
    """Draw time against the number of runs and against their length."""
    figure = Figure(figsize=(10.0, 4.0), layout="constrained")
    left, right = figure.subplots(1, 2)
    left.loglog(COUNTS, seconds["by_count"], "o-", color="#0072b2")
    left.set(xlabel="runs of 60 s at 100 Hz", ylabel="time [s]", title="Number of runs")
    right.loglog(LENGTHS_S, seconds["by_length"], "o-", color="#d55e00")
    right.set(xlabel="length of each of 10 runs [s]", ylabel="time [s]", title="Length")
    for axes in (left, right):
        axes.grid(True, which="both", alpha=0.3)
    return figure


if __name__ == "__main__":
    sys.exit(main())
