"""Compare all laws over delay, jitter, loss and actuator lag, and show where each breaks.

    steer-by-wire compare [--out DIR] [--step-ms 25] [--seeds 3]
    steer-by-wire compare --at-speed     # networks with memory at 5, 30 and 60 km/h: docs/packet.md
    steer-by-wire compare --interior 256 # the predictors between the corners of the box

Leaves in DIR comparison.csv, a line for each law, network and delay; comparison.png of the point
that each law follows, comparison_centre_of_gravity.png and error_over_delay.png; and comparison.md,
the tables of docs/predictor.md. Prints the worst RMS over the uncertainty box at a few delays, and
the first delay at which a law does not hold the path. Ctrl-C leaves the lines that are complete.
"""

import argparse
import csv
import sys
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from rich.progress import BarColumn, MofNCompleteColumn, TimeRemainingColumn

from steer_by_wire.command_line import (
    add_out_argument,
    add_overrides_argument,
    command_parser,
    whole_number,
)
from steer_by_wire.runtime.program import ExitStatus, StopRequest, run_main
from steer_by_wire.terminal import plain_console, progress_bars
from steer_by_wire.tools.compare_laws.at_speed import (
    DELAYS_S,
    compare_at_speed,
    markdown_at_speed,
)
from steer_by_wire.tools.compare_laws.at_speed import Cell as CellAtSpeed
from steer_by_wire.tools.compare_laws.interior import PREDICTORS, interior_line, interior_points
from steer_by_wire.tools.compare_laws.picture import draw_break_points, draw_comparison
from steer_by_wire.tools.compare_laws.runs import Cell, compare, controller_settings, own_contestant
from steer_by_wire.tools.compare_laws.tables import markdown_lines, table_lines

NAME = "steer-by-wire compare"
DELAY_MS_MAX = 600
INTERIOR_MAX = 10_000


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    parser = command_parser(NAME, __doc__, f"{NAME} --step-ms 100 --seeds 1 --duration-s 20")
    add_out_argument(parser, "out/comparison")
    parser.add_argument(
        "--step-ms",
        type=int,
        default=25,
        choices=(10, 20, 25, 50, 100),
        help="step between delays (default: %(default)s)",
    )
    parser.add_argument(
        "--seeds",
        type=int,
        default=3,
        choices=range(1, 101),
        metavar="1..100",
        help="seeds per random network (default: %(default)s)",
    )
    parser.add_argument(
        "--duration-s",
        type=float,
        default=60.0,
        choices=(20.0, 60.0, 120.0),
        metavar="S",
        help="duration of each run: 20, 60 or 120 (default: %(default)g)",
    )
    parser.add_argument(
        "--interior",
        type=whole_number(0, INTERIOR_MAX),
        default=0,
        metavar="POINTS",
        help="instead the predictors' centre of gravity at so many points inside the box",
    )
    parser.add_argument(
        "--law",
        action="append",
        default=[],
        metavar="PACKAGE.MODULE:LAW",
        help="a law of your own, with the tables of practical_pd_ddob; repeatable",
    )
    add_overrides_argument(
        parser, "--law-set", "a setting of your laws, such as own_law.gain=2", dest=None
    )
    parser.add_argument(
        "--at-speed",
        action="store_true",
        help="instead a lane change at 5, 30 and 60 km/h on networks with memory",
    )
    options = parser.parse_args(arguments)
    run = _run_interior if options.interior else _run_at_speed if options.at_speed else _run
    return run_main(NAME, partial(run, options))


def _run_at_speed(options: argparse.Namespace) -> int:
    options.out.mkdir(parents=True, exist_ok=True)
    stop = StopRequest()
    bars = progress_bars(
        plain_console(), BarColumn(30), MofNCompleteColumn(), TimeRemainingColumn()
    )
    with stop.on_signals(), bars:
        task = bars.add_task("")
        cells = compare_at_speed(
            DELAYS_S,
            options.seeds,
            lambda done, of: bars.update(task, completed=done, total=of),
            should_stop=stop,
        )
    _write(cells, options.out / "at_speed.csv")
    if stop.reason:
        print(f"interrupted: {len(cells)} results are in {options.out / 'at_speed.csv'}")
        return ExitStatus.INTERRUPTED
    text = "\n".join(markdown_at_speed(cells))
    (options.out / "at_speed.md").write_text(text, encoding="utf-8")
    print(text)
    return ExitStatus.OK


def _run_interior(options: argparse.Namespace) -> int:
    for one in PREDICTORS:
        print(interior_line(one, interior_points(options.interior, options.duration_s, one)))
    return ExitStatus.OK


def _run(options: argparse.Namespace) -> int:
    begin_s = time.perf_counter()
    further = [own_contestant(law, options.law_set) for law in options.law]
    for one in further:  # before anything is run
        controller_settings(one, has_lag=False)
    options.out.mkdir(parents=True, exist_ok=True)
    console = plain_console()
    delays_s = [1e-3 * ms for ms in range(0, DELAY_MS_MAX + 1, options.step_ms)]
    stop = StopRequest()
    with (
        stop.on_signals(),
        progress_bars(console, BarColumn(30), MofNCompleteColumn(), TimeRemainingColumn()) as bars,
    ):
        task = bars.add_task("")
        cells = compare(
            delays_s,
            options.seeds,
            options.duration_s,
            lambda done, of: bars.update(task, completed=done, total=of),
            further,
            stop,
        )
    _write(cells, options.out / "comparison.csv")
    if stop.reason:
        print(f"interrupted: {len(cells)} results are in {options.out / 'comparison.csv'}")
        return ExitStatus.INTERRUPTED
    draw_comparison(cells, further).savefig(options.out / "comparison.png", dpi=110)
    draw_break_points(cells).savefig(options.out / "error_over_delay.png", dpi=130)
    of_cg = draw_comparison(cells, further, of_cg=True)
    of_cg.savefig(options.out / "comparison_centre_of_gravity.png", dpi=110)
    markdown = "\n".join([*markdown_lines(cells, further), ""])
    (options.out / "comparison.md").write_text(markdown, encoding="utf-8")
    for line in table_lines(cells, further):
        print(line)
    elapsed_s = time.perf_counter() - begin_s
    print(f"\n{elapsed_s:.0f} s; tables and pictures are in {options.out}")
    return ExitStatus.OK


def _write(cells: Sequence[Cell] | Sequence[CellAtSpeed], path: Path) -> None:
    with path.open("w", newline="", encoding="utf-8") as opened:
        writer = csv.writer(opened)
        writer.writerow(cells[0]._fields)
        writer.writerows(cells)


if __name__ == "__main__":
    sys.exit(main())
