"""Picture of ``steer-by-wire feedback``: the first unstable round trip over the torque gradient."""

from collections.abc import Iterable
from itertools import groupby

from matplotlib.figure import Figure

from steer_by_wire.closed_loop.reports.plot_style import plot_style, png_of

FIRST_MS_MIN = 1.0
"""Of the logarithmic axis; what is unstable without a delay lies below it."""


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
