"""Runs the pair over the load, the bit error rate and the clocks of its bus, in virtual time.

    steer-by-wire bus-study --load 0.7 --bit-error-rate 1e-6 1e-5 1e-4 1e-3 --csv study.csv

Every combination is run with every seed. Other people's traffic is that of ``--rest-bus``, or of a
made message set. Exit status 0 whatever the loop does; Ctrl-C ends the study with the runs that are
done.
"""

import argparse
import csv
import sys
from collections.abc import Sequence
from functools import partial
from io import StringIO

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, TimeRemainingColumn

from steer_by_wire.command_line import command_parser, number, whole_number
from steer_by_wire.runtime.bus_settings import BusSettings
from steer_by_wire.runtime.option_types import output_file
from steer_by_wire.runtime.program import ExitStatus, StopRequest, run_main
from steer_by_wire.runtime.report import write_file
from steer_by_wire.runtime.settings import COMMAND_LINE, with_values
from steer_by_wire.terminal import progress_bars
from steer_by_wire.tools.bus_study.presentation import draw, table_of
from steer_by_wire.tools.bus_study.runs import BusRun, Point, runs_of

NAME = "steer-by-wire bus-study"
RATES = (0.0, 1e-6, 1e-5, 1e-4, 1e-3)
CONTROLLERS = ("practical_pd", "practical_pd_ddob")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study; returns the exit status."""
    return run_main(NAME, partial(_run, _parse(arguments)))


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = command_parser(NAME, __doc__, f"{NAME} --load 0.7 0.9 --picture bus_study.png")
    parser.add_argument(
        "--load", type=number(0.0, 1.5), nargs="+", default=[0.7], metavar="SHARE",
        help="of the bus that other people's messages take (default: 0.7)",
    )  # fmt: skip
    parser.add_argument(
        "--bit-error-rate", type=number(0.0, 0.01), nargs="+", default=list(RATES),
        metavar="RATE", help="default: 0 and 1e-6 to 1e-3",
    )  # fmt: skip
    parser.add_argument(
        "--clock-ppm", type=number(-10_000.0, 10_000.0), nargs="+", default=[0.0], metavar="PPM",
        help="how much faster the plant's clock is than the controller's (default: 0)",
    )  # fmt: skip
    parser.add_argument(
        "--controller-preset", nargs="+", default=list(CONTROLLERS), metavar="NAME",
        help=f"default: {' '.join(CONTROLLERS)}",
    )  # fmt: skip
    parser.add_argument(
        "--rest-bus", nargs="+", default=[], metavar="FILE.dbc",
        help="whose messages are sent (default: eighteen made ones)",
    )  # fmt: skip
    parser.add_argument(
        "--seeds", type=whole_number(1, 1000), default=3, metavar="N",
        help="runs of each combination (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--duration", type=number(1.0, 3600.0), default=20.0, metavar="SECONDS",
        help="of each run (default: %(default)g)",
    )  # fmt: skip
    parser.add_argument("--csv", type=output_file, metavar="FILE", help="write every run")
    parser.add_argument("--picture", type=output_file, metavar="FILE.png", help="draw the figures")
    return parser.parse_args(arguments)


def _run(options: argparse.Namespace) -> int:
    points = [
        Point(load, rate, ppm)
        for load in options.load
        for rate in options.bit_error_rate
        for ppm in options.clock_ppm
    ]
    base = with_values(BusSettings(), {"rest_bus": options.rest_bus}, COMMAND_LINE)
    seeds, presets = range(1, options.seeds + 1), options.controller_preset
    console, stop = Console(markup=False, highlight=False), StopRequest()
    console.width = max(console.width, 140)
    runs, total = [], len(points) * len(presets) * len(seeds)
    with (
        stop.on_signals(),
        progress_bars(console, BarColumn(30), MofNCompleteColumn(), TimeRemainingColumn()) as bars,
    ):
        task = bars.add_task("", total=total)
        for run in runs_of(points, presets, base, seeds, options.duration, stop):
            runs.append(run)
            bars.advance(task)
    if runs:
        console.print(table_of(runs))
        if options.csv is not None:
            write_file(options.csv, _csv_of(runs))
        if options.picture is not None:
            write_file(options.picture, draw(runs))
    if len(runs) < total:
        console.print(f"interrupted by {stop.reason}: {len(runs)} of {total} runs")
        return ExitStatus.INTERRUPTED
    return ExitStatus.OK


def _csv_of(runs: Sequence[BusRun]) -> bytes:
    text = StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*Point._fields, *BusRun._fields[1:]])
    writer.writerows([*run.point, *run[1:]] for run in runs)
    return text.getvalue().encode()


if __name__ == "__main__":
    sys.exit(main())
