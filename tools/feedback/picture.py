"""Pictures of ``steer-by-wire feedback``: first unstable round trips, and the frontier of laws."""

from collections.abc import Iterable
from itertools import groupby

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


def draw(first_s: Iterable[tuple[float, str, float, float]], cycle_s: float, title: str) -> bytes:
    """Return a PNG with a panel for each speed and a curve for each grip.

    ``first_s``  speed [km/h], grip, torque gradient [N m/rad], first unstable round trip [s]
    """
    by_speed = [(speed, list(rows)) for speed, rows in groupby(sorted(first_s), lambda row: row[0])]
    with plot_style():
        figure = Figure(figsize=(4.0 * len(by_speed), 4.0))
        panels = figure.subplots(1, len(by_speed), sharey=True, squeeze=False)[0]
        for axes, (speed_km_h, rows) in zip(panels, by_speed, strict=True):
            for grip, curve in groupby(rows, lambda row: row[1]):
                points = [(row[2], max(1e3 * row[3], 0.1)) for row in curve]
                axes.plot(*zip(*points, strict=True), label=grip.replace("_", " "))
            axes.axhline(2e3 * cycle_s, color="0.5", linewidth=1.0)
            axes.set(
                title=f"{title}, {speed_km_h:g} km/h", xscale="log", yscale="log",
                xlabel="torque gradient [N m/rad]", ylim=(FIRST_MS_MIN, None),
            )  # fmt: skip
            axes.annotate("a cycle each way", (1.0, 2.1e3 * cycle_s), color="0.4", fontsize=8)
        panels[0].set_ylabel("first unstable round trip [ms]")
        panels[-1].legend()
    return png_of(figure)


def draw_frontier(points: Iterable[Point], title: str) -> bytes:
    """Return a PNG: how changed and how late the road is felt, over the round trip of the bus."""
    by_law = [(law, list(each)) for law, each in groupby(points, lambda point: point.law)]
    with plot_style():
        figure = Figure(figsize=(10.0, 4.2))
        changed, late = figure.subplots(1, 2, sharex=True)
        for law, each in by_law:
            trips = [1e3 * point.round_trip_s for point in each]
            changed.plot(trips, [1e2 * point.changed for point in each], marker=".", label=law)
            late.plot(trips, [1e3 * point.late_s for point in each], marker=".")
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
    return png_of(figure)
