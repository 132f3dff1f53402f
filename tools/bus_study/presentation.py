"""The runs of a study as a table and as a picture; means over the seeds."""

from collections.abc import Sequence
from statistics import fmean

from matplotlib.figure import Figure
from rich.table import Table

from ...reports.plot_style import COLOURS, plot_style, png_of
from ...terminal import plain_table
from .runs import BusRun, Point

Group = tuple[Point, str, list[BusRun]]


def groups_of(runs: Sequence[BusRun]) -> list[Group]:
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
