"""The runs of a study as a table and as a picture; means over the seeds."""

from collections.abc import Sequence
from statistics import fmean

from matplotlib.figure import Figure
from rich.table import Table

from ...reports.plot_style import COLOURS, plot_style, png_of
from .runs import BusRun, Point

Group = tuple[Point, str, list[BusRun]]


def groups_of(runs: Sequence[BusRun]) -> list[Group]:
    """Return the runs by point and controller, in their order."""
    groups: dict[tuple[Point, str], list[BusRun]] = {}
    for run in runs:
        groups.setdefault((run.point, run.controller), []).append(run)
    return [(point, controller, members) for (point, controller), members in groups.items()]


def table_of(runs: Sequence[BusRun]) -> Table:
    """Return a row for each point and controller."""
    table = Table(
        box=None, pad_edge=False, caption_justify="left",
        caption="RMS: of the preview point. Counts: mean of a run. worst: of all seeds.",
    )  # fmt: skip
    table.add_column("controller", no_wrap=True)
    for heading in (
        "load", "bit errors", "clocks", "RMS", "busy", "errors", "twice", "bus-off", "lost", "worst"
    ):  # fmt: skip
        table.add_column(heading, justify="right", no_wrap=True)
    for point, controller, members in groups_of(runs):
        table.add_row(
            controller,
            f"{100 * point.load:.0f} %",
            f"{point.bit_error_rate:g}",
            f"{point.clock_ppm:g} ppm",
            f"{1e3 * fmean(run.rms_m for run in members):.2f} mm",
            f"{100 * fmean(run.bus_load for run in members):.1f} %",
            *(
                f"{fmean(getattr(run, name) for run in members):.1f}"
                for name in ("detected", "twice", "bus_offs", "lost")
            ),
            max((run.verdict for run in members), key=lambda verdict: verdict != "holds"),
        )
    return table


def draw(runs: Sequence[BusRun]) -> bytes:
    """Return RMS and error frames over the bit error rate, as PNG; a rate of 0 is left out."""
    with plot_style():
        figure = Figure(figsize=(7.5, 3.4))
        left, right = figure.subplots(1, 2)
        lines = sorted({(p.load, p.clock_ppm, c) for p, c, _ in groups_of(runs)})
        for number, (load, ppm, controller) in enumerate(lines):
            chosen = [
                (point.bit_error_rate, members)
                for point, name, members in groups_of(runs)
                if (point.load, point.clock_ppm, name) == (load, ppm, controller)
                and point.bit_error_rate > 0
            ]
            rates = [rate for rate, _ in chosen]
            label = f"{controller}, {100 * load:.0f} %" + (f", {ppm:g} ppm" if ppm else "")
            colour = COLOURS[number % len(COLOURS)]
            rms_mm = [1e3 * fmean(run.rms_m for run in members) for _, members in chosen]
            left.plot(rates, rms_mm, marker="o", color=colour, label=label)
            detected = [fmean(run.detected for run in members) for _, members in chosen]
            right.plot(rates, detected, marker="o", color=colour)
        for axes, title in ((left, "lateral error, RMS [mm]"), (right, "error frames in a run")):
            axes.set_xscale("log")
            axes.set_xlabel("bit error rate")
            axes.set_title(title)
        left.set_ylim(bottom=0.0)
        right.set_yscale("log")
        left.legend(loc="best")
        return png_of(figure)
