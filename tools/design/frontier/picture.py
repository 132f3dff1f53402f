"""Pictures of the frontier: the error over the guaranteed delay."""

import math
from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from ....closed_loop.reports.plot_style import law_styles
from ..specification import controller_law
from .points import Point
from .settings import STRUCTURES, Panel

_MARKS = {"PD + map": "s", "PID + heading": "^"}
"""Of structures that have the line of another one; all others have a dot."""


def draw_frontier(panels: Sequence[Panel], points: Sequence[Point]) -> Figure:
    """Draw panels side by side, one line for each structure; a cross where a run is lost."""
    figure = Figure(figsize=(8.0 if len(panels) == 1 else 6.0 * len(panels), 5.0))
    (row,) = figure.subplots(1, len(panels), squeeze=False, sharey="row")
    for axes, panel in zip(row, panels, strict=True):
        _draw_panel(axes, panel, points)
    row[0].set_ylabel("RMS of the car, without noise [mm]")
    figure.legend(
        *row[0].get_legend_handles_labels(),
        title="structure: what it reads with the lateral error",
        fontsize=8,
        ncols=2,
        loc="outside upper center",
    )
    asked = panels[0].asked
    noise = ", ".join(f"{panel.table.noise_gain_rad_m_max:g}" for panel in panels)
    figure.text(
        0.01, -0.02,
        f"Worst of the vehicle's corners and of all delays up to the one shown, from"
        f" {asked.ignore_s:g} s on; noise on the wheel at most {noise} rad"
        f" per m;\npeak sensitivity at most {asked.peak_sensitivity_max:g}; stable to"
        f" {1.0 + asked.margin_share:g} times the delay. All structures meet the same demands.",
        fontsize=7.5, color="0.35", va="top",
    )  # fmt: skip
    return figure


def _draw_panel(axes: Axes, panel: Panel, points: Sequence[Point]) -> None:
    for structure in panel.asked.structures:
        law, alone = STRUCTURES[structure].law, not STRUCTURES[structure].follows_car
        (style,) = law_styles([controller_law(law)])
        mark = "x" if alone else _MARKS.get(structure, "o")
        place = (panel.table.name, structure)
        chosen = [point for point in points if (point.panel, point.structure) == place]
        held = [point for point in chosen if math.isfinite(point.rms_m)]
        axes.plot(
            [point.delay_ms for point in held], [1e3 * point.rms_m for point in held],
            marker=mark, ms=4.5, label=f"{structure}: {STRUCTURES[structure].reads}", **style,
        )  # fmt: skip
        lost = [point.delay_ms for point in chosen if math.isinf(point.rms_m)]
        if lost:
            axes.plot(
                lost, [1.0] * len(lost), "x", ms=7, color=style["color"], clip_on=False,
                transform=axes.get_xaxis_transform(),
            )  # fmt: skip
    axes.set(
        yscale="log",
        xlabel="guaranteed delay [ms]",
    )
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _place: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set_title(f"Least error found, {panel.table.name}", fontsize=11)
