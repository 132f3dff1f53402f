"""Runs the pair over the load, the bit error rate and the clocks of its bus, in virtual time.

    steer-by-wire bus-study --load 0.7 --bit-error-rate 1e-6 1e-5 1e-4 1e-3 --csv study.csv

Every combination is run with every seed. Other people's traffic is that of ``--rest-bus``, or of a
made message set. Exit status 0 whatever the loop does.
"""

import argparse
import csv
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from rich.console import Console

from steer_by_wire.command_line import command_parser, number, whole_number
from steer_by_wire.dbc.message_set import read_message_set
from steer_by_wire.pair.virtual import BITRATE_BIT_S
from steer_by_wire.runtime.option_types import output_file
from steer_by_wire.runtime.program import ExitStatus, run_main
from steer_by_wire.runtime.settings import SettingsError
from steer_by_wire.tools.bus_study.presentation import draw, table_of
from steer_by_wire.tools.bus_study.runs import BusRun, Point, example_messages, runs_of

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
        "--rest-bus", type=Path, nargs="+", default=[], metavar="FILE.dbc",
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
    try:
        listed = [m for file in options.rest_bus for m in read_message_set(file)]
        messages = listed or example_messages()
        seeds = range(1, options.seeds + 1)
        presets = options.controller_preset
        runs = list(runs_of(points, presets, messages, seeds, options.duration, BITRATE_BIT_S))
    except OSError as error:
        raise SettingsError(f"--rest-bus {error.filename}: {error.strerror}") from error
    except ValueError as error:
        raise SettingsError(str(error)) from error
    console = Console(markup=False, highlight=False)
    console.width = max(console.width, 110)
    console.print(table_of(runs))
    if options.csv is not None:
        _write_csv(options.csv, runs)
    if options.picture is not None:
        options.picture.write_bytes(draw(runs))
    return ExitStatus.OK


def _write_csv(path: Path, runs: Sequence[BusRun]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([*Point._fields, *BusRun._fields[1:]])
        writer.writerows([*run.point, *run[1:]] for run in runs)


if __name__ == "__main__":
    sys.exit(main())
