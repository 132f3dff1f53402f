"""Picture of the frontier: the error over the guaranteed delay."""

import math
from collections.abc import Sequence

from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from ....closed_loop.reports.plot_style import law_styles
from ..specification import controller_law
from .points import Point
from .settings import STRUCTURES, FrontierSettings

_MARKS = {"PD + map": "s", "PID + heading": "^"}
"""Of structures that have the line of another one; all others have a dot."""


def draw_frontier(asked: FrontierSettings, points: Sequence[Point]) -> Figure:
    """Draw the error over the delay, one line for each structure; a cross where a run is lost."""
    figure = Figure(figsize=(8.0, 5.0))
    axes = figure.subplots()
    for structure in asked.structures:
        law, alone = STRUCTURES[structure].law, not STRUCTURES[structure].follows_car
        (style,) = law_styles([controller_law(law)])
        mark = "x" if alone else _MARKS.get(structure, "o")
        chosen = [point for point in points if point.structure == structure]
        held = [point for point in chosen if math.isfinite(point.rms_m)]
        axes.plot(
            [point.delay_ms for point in held], [1e3 * point.rms_m for point in held],
            marker=mark, ms=4.5, label=f"{structure}: {STRUCTURES[structure].reads}", **style,
        )  # fmt: skip
        lost = [point.delay_ms for point in chosen if math.isinf(point.rms_m)]
        axes.plot(
            lost, [1.0] * len(lost), "x", ms=7, color=style["color"], clip_on=False,
            transform=axes.get_xaxis_transform(),
        )  # fmt: skip
    axes.set(
        yscale="log",
        xlabel="guaranteed delay [ms]: every corner is stable to"
        f" {1.0 + asked.margin_share:g} times it",
        ylabel="RMS of the car, without noise [mm]",
    )
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _place: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set_title("Least error that a search found for each structure", fontsize=11)
    figure.legend(
        title="structure: what it reads with the lateral error",
        fontsize=8,
        ncols=2,
        loc="outside upper center",
    )
    figure.text(
        0.01, -0.02,
        f"Worst of the vehicle's corners and of all delays up to the one shown, from"
        f" {asked.ignore_s:g} s on; noise on the wheel at most {asked.noise_gain_rad_m_max:g} rad"
        f" per m;\npeak sensitivity at most {asked.peak_sensitivity_max:g}. All structures meet"
        " the same demands.",
        fontsize=7.5, color="0.35", va="top",
    )  # fmt: skip
    return figure
