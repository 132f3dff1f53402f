"""Picture of the frontier: the error over the guaranteed delay."""

import math
from collections.abc import Mapping, Sequence

from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from ....closed_loop.reports.plot_style import COLOURS
from .points import PREDICTOR, Point
from .settings import FrontierSettings

_LOOK: Mapping[str, tuple[str, str]] = {
    "PD": (COLOURS[6], "o-"),
    "PD + map": (COLOURS[6], "o--"),
    "PD + CDOB": (COLOURS[0], "s-"),
    "PD + DOB": (COLOURS[4], "^-"),
    "PD + DDOB": (COLOURS[3], "D-"),
    "PID": (COLOURS[1], "v-"),
    "PID + heading": (COLOURS[1], "v--"),
    PREDICTOR: (COLOURS[2], "P:"),
}


def draw_frontier(asked: FrontierSettings, points: Sequence[Point]) -> Figure:
    """Draw the error over the delay, one line for each structure; a cross where a run is lost."""
    figure = Figure(figsize=(8.0, 5.0))
    axes = figure.subplots()
    for structure, (colour, style) in _LOOK.items():
        chosen = [point for point in points if point.structure == structure]
        held = [point for point in chosen if math.isfinite(point.rms_m)]
        axes.plot(
            [point.delay_ms for point in held], [1e3 * point.rms_m for point in held], style,
            ms=4.5, color=colour, label=structure,
        )  # fmt: skip
        lost = [point.delay_ms for point in chosen if math.isinf(point.rms_m)]
        axes.plot(
            lost, [1.0] * len(lost), "x", ms=7, color=colour, clip_on=False,
            transform=axes.get_xaxis_transform(),
        )  # fmt: skip
    axes.set(
        yscale="log",
        xlabel="guaranteed delay [ms]: every corner is stable to"
        f" {1.0 + asked.margin_share:g} times it",
        ylabel="RMS of the lateral error [mm]",
    )
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _place: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set_title("Least error of each structure, each at its own best", fontsize=11)
    figure.legend(fontsize=8, ncols=4, loc="outside upper center")
    figure.text(
        0.01, -0.02,
        f"Worst of the vehicle's corners and of all delays up to the one shown; noise on the wheel"
        f" at most {asked.noise_gain_rad_m_max:g} rad per m;\npeak sensitivity at most"
        f" {asked.peak_sensitivity_max:g}. Predictor: the shipped preset, which reads more signals"
        " and passes less noise.",
        fontsize=7.5, color="0.35", va="top",
    )  # fmt: skip
    return figure
