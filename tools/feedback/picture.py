"""Pictures of ``steer-by-wire feedback``: first unstable round trips, and the frontier of laws."""

from collections.abc import Iterable, Sequence
from itertools import groupby
from math import isfinite

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from steer_by_wire.closed_loop.reports.plot_style import plot_style, png_of
from steer_by_wire.tools.feedback.frontier import Point

FIRST_MS_MIN = 1.0
"""Of the logarithmic axis; what is unstable without a delay lies below it."""
FELT_LATE_MS = {
    45.0: "sight against touch",
    75.0: "tasks suffer",
    200.0: "steering suffers severely",
}
"""As the literature has it (Smith and Kaplan 1970 for the last); none is of a steer-by-wire."""
REAL_BUS_MS = 20.0
"""A cycle of 10 ms each way."""


def draw(
    models: Iterable[Iterable[tuple[float, str, float, float]]], cycle_s: float, title: str
) -> bytes:
    """Return a PNG with a panel for each speed and a curve for each grip.

    ``models``  speed [km/h], grip, torque gradient [N m/rad], first unstable round trip [s]: with
                tyres that follow at once and, dashed, with tyres that lag
    """
    by_model = [groupby(sorted(rows), lambda row: row[0]) for rows in models]
    by_speed = [[(speed, list(rows)) for speed, rows in each] for each in by_model]
    with plot_style():
        figure = Figure(figsize=(4.0 * len(by_speed[0]), 4.0))
        panels = figure.subplots(1, len(by_speed[0]), sharey=True, squeeze=False)[0]
        for axes, *drawn in zip(panels, *by_speed, strict=True):
            speed_km_h = drawn[0][0]
            for (_, rows), dash in zip(drawn, ("-", "--"), strict=False):
                curves = groupby(rows, lambda row: row[1])
                for number, (grip, curve) in enumerate(curves):
                    points = [(row[2], max(1e3 * row[3], 0.1)) for row in curve]
                    label = grip.replace("_", " ") if dash == "-" else None
                    line = f"C{number}{dash}"
                    axes.plot(*zip(*points, strict=True), line, label=label)
            axes.axhline(2e3 * cycle_s, color="0.5", linewidth=1.0)
            axes.set(
                title=f"{title}, {speed_km_h:g} km/h", xscale="log", yscale="log",
                xlabel="torque gradient [N m/rad]", ylim=(FIRST_MS_MIN, None),
            )  # fmt: skip
            axes.annotate("a cycle each way", (1.0, 2.1e3 * cycle_s), color="0.4", fontsize=8)
        if len(by_speed) > 1:
            panels[-1].plot([], [], "k--", label="tyres that lag")
        panels[0].set_ylabel("first unstable round trip [ms]")
        panels[-1].legend(loc="upper right", ncols=2, fontsize=8)
    return png_of(figure)


def draw_frontier(models: Sequence[Iterable[Point]], title: str) -> bytes:
    """Return a PNG: how changed and how late the road is felt, over the round trip of the bus.

    ``models``  with tyres that follow at once and, below, with tyres that lag
    """
    with plot_style():
        figure = Figure(figsize=(10.0, 4.2 * len(models)))
        for row, points in enumerate(models):
            panels = [figure.add_subplot(len(models), 2, 2 * row + side) for side in (1, 2)]
            below = ", tyres that lag" if row else ""
            _draw_laws(panels[0], panels[1], points, f"{title}{below}")
    return png_of(figure)


def _draw_laws(changed: Axes, late: Axes, points: Iterable[Point], title: str) -> None:
    for law, each in groupby(points, lambda point: point.law):
        of_law = list(each)
        trips = [1e3 * point.round_trip_s for point in of_law]
        label = law if any(isfinite(point.changed) for point in of_law) else None
        changed.plot(trips, [1e2 * point.changed for point in of_law], marker=".", label=label)
        late.plot(trips, [1e3 * point.late_s for point in of_law], marker=".")
    for at_ms, words in FELT_LATE_MS.items():
        late.axhline(at_ms, color="0.6", linewidth=0.8)
        late.annotate(words, (trips[0], 1.04 * at_ms), color="0.4", fontsize=8)
    for axes, what in ((changed, "felt torque changed by [%]"), (late, "road felt after [ms]")):
        axes.axvspan(trips[0], REAL_BUS_MS, color="0.5", alpha=0.12)
        axes.set(xscale="log", yscale="log", xlabel="round trip of the bus [ms]", ylabel=what)
        axes.set_xticks(trips, [f"{trip:g}" for trip in trips], minor=False)
        axes.set_xticks([], minor=True)
        axes.yaxis.set_major_formatter("{x:g}")
    changed.set(title=title, ylim=(2.0, 2000.0))
    changed.annotate("a cycle of 10 ms each way", (trips[0], 2.2), color="0.4", fontsize=8)
    changed.legend(fontsize=8)
