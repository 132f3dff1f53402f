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
from itertools import product, starmap
from statistics import fmean

from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table

from steer_by_wire.closed_loop.reports.plot_style import COLOURS, plot_style, png_of
from steer_by_wire.closed_loop.reports.terminal import counting_bars, plain_table
from steer_by_wire.runtime.bus_model.settings import BusSettings
from steer_by_wire.runtime.command_line import command_parser, number, whole_number
from steer_by_wire.runtime.program.option_types import output_file
from steer_by_wire.runtime.program.program import ExitStatus, StopRequest, run_main
from steer_by_wire.runtime.program.report import write_file
from steer_by_wire.runtime.settings import COMMAND_LINE, with_values
from steer_by_wire.tools.bus_study.runs import BusRun, Point, runs_of

NAME = "steer-by-wire bus-study"
RATES = (0.0, 1e-6, 1e-5, 1e-4, 1e-3)
CONTROLLERS = ("practical_pd", "practical_pd_ddob")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study; returns the exit status."""
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
    return run_main(NAME, partial(_run, parser.parse_args(arguments)))


def _run(options: argparse.Namespace) -> int:
    points = list(starmap(Point, product(options.load, options.bit_error_rate, options.clock_ppm)))
    base = with_values(BusSettings(), {"rest_bus": options.rest_bus}, COMMAND_LINE)
    seeds, presets = range(1, options.seeds + 1), options.controller_preset
    console, stop = Console(markup=False, highlight=False), StopRequest()
    console.width = max(console.width, 140)
    runs, total = [], len(points) * len(presets) * len(seeds)
    with stop.on_signals(), counting_bars(console) as bars:
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


def groups_of(runs: Sequence[BusRun]) -> list[tuple[Point, str, list[BusRun]]]:
    """Return the runs by point and controller, in their order."""
    groups: dict[tuple[Point, str], list[BusRun]] = {}
    for run in runs:
        groups.setdefault((run.point, run.controller), []).append(run)
    return [(point, controller, members) for (point, controller), members in groups.items()]


COUNTS = {
    "detected": "errors",
    "repeated": "again",
    "twice": "twice",
    "bus_offs": "bus-off",
    "lost": "lost",
    "steering_lost": "steering",
}
"""Counts of a run, and their headings."""
DRAWN = {
    "detected": "errors, sent again",
    "twice": "received twice",
    "bus_offs": "bus-offs",
    "lost": "frames lost",
    "steering_lost": "steering lost",
}
"""Counts in the picture: all but a few of the errors lead to a repetition."""


def table_of(runs: Sequence[BusRun]) -> Table:
    """Return a row for each point and controller."""
    headings = ("load", "bit errors", "clocks", "RMS", "trip", "silence", "busy")
    table = plain_table(["controller"], (*headings, *COUNTS.values(), "worst"))
    table.caption = (
        "RMS: of the preview point. trip: from measurement to echo, 99 % below. "
        "silence: the longest between two\ncommands. "
        "Counts: mean of a run; steering: of the pair's frames, lost. worst: of all seeds."
    )
    for point, controller, members in groups_of(runs):
        table.add_row(
            controller,
            f"{100 * point.load:.0f} %",
            f"{point.bit_error_rate:g}",
            f"{point.clock_ppm:g} ppm",
            f"{1e3 * fmean(run.rms_m for run in members):.2f} mm",
            f"{1e3 * max(run.round_trip_s for run in members):.1f} ms",
            f"{1e3 * max(run.silence_s for run in members):.1f} ms",
            f"{100 * fmean(run.bus_load for run in members):.1f} %",
            *(_count(fmean(getattr(run, name) for run in members)) for name in COUNTS),
            max((run.verdict for run in members), key=lambda verdict: verdict != "holds"),
        )
    return table


def _count(mean: float) -> str:
    return f"{mean:.1f}" if 0 < mean < 100 else f"{mean:.0f}"


def draw(runs: Sequence[BusRun]) -> bytes:
    """Return what changes over the bit error rate as PNG; a rate of 0 is left out.

    Lateral error and times of every line of runs; the counts of the last one.
    """
    with plot_style():
        figure = Figure(figsize=(10.5, 3.6))
        left, middle, right = figure.subplots(1, 3)
        lines = sorted({(p.load, p.clock_ppm, c) for p, c, _ in groups_of(runs)})
        chosen: list[tuple[float, list[BusRun]]] = []
        for number, (load, ppm, controller) in enumerate(lines):
            chosen = [
                (point.bit_error_rate, members)
                for point, name, members in groups_of(runs)
                if (point.load, point.clock_ppm, name) == (load, ppm, controller)
                and point.bit_error_rate > 0
            ]
            rates = [rate for rate, _ in chosen]
            label = f"{controller}, {100 * load:.0f} %" + (f", {ppm:g} ppm" if ppm else "")
            style = {"marker": "o", "markersize": 4, "color": COLOURS[number % len(COLOURS)]}
            rms_mm = [1e3 * fmean(run.rms_m for run in members) for _, members in chosen]
            left.plot(rates, rms_mm, label=label, **style)
            trip_ms = [1e3 * max(run.round_trip_s for run in members) for _, members in chosen]
            middle.plot(rates, trip_ms, **style)
            silence_ms = [1e3 * max(run.silence_s for run in members) for _, members in chosen]
            middle.plot(rates, silence_ms, linestyle=":", **style)
        for number, (name, label) in enumerate(DRAWN.items()):
            counts = [
                (rate, fmean(getattr(run, name) for run in members)) for rate, members in chosen
            ]
            seen = [(rate, count) for rate, count in counts if count]
            if seen:
                colour = COLOURS[number % len(COLOURS)]
                right.plot(*zip(*seen, strict=True), marker="o", markersize=4, color=colour)
                right.annotate(
                    label, seen[-1], xytext=(5, -3),
                    textcoords="offset points", color=colour, fontsize=8,
                )  # fmt: skip
        titles = ("lateral error, RMS [mm]", "round trip, silence (dotted) [ms]", "in a run")
        for axes, title in zip((left, middle, right), titles, strict=True):
            axes.set(xscale="log", xlabel="bit error rate", title=title)
        for axes in (left, middle):
            axes.set_ylim(bottom=0.0)
        right.set_yscale("log")
        right.margins(x=0.3)
        left.legend(loc="best")
        return png_of(figure)


if __name__ == "__main__":
    sys.exit(main())
