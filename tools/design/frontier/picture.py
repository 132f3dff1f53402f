"""Pictures of the frontier: the error over the guaranteed delay, and the trials beside it."""

import math
from collections.abc import Callable, Mapping, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from ....closed_loop.reports.plot_style import COLOURS
from .points import FILTERED, PREDICTOR, PUBLISHED, Row
from .settings import FrontierSettings
from .trials import JITTER_SHARE, LAG_S, SENSOR_NOISE_M, SIDE_FORCE_N, STEERING_OFFSET_RAD

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
_GREY = "0.5"
_PER_MM = 1e3
_LEFT_MM_MIN = 0.01
FigureOf = Callable[[Row], float]


def draw_frontier(asked: FrontierSettings, rows: Sequence[Row]) -> Figure:
    """Draw the error over the delay, one line for each structure."""
    figure = Figure(figsize=(8.0, 5.0))
    axes = figure.subplots()
    _lines(axes, rows, lambda row: _PER_MM * row.point.rms_m, is_named=True)
    _marks(axes, rows)
    axes.set(
        yscale="log",
        xlabel="guaranteed delay [ms]: every corner is stable to"
        f" {1.0 + asked.margin_share:g} times it",
        ylabel="RMS of the lateral error [mm]",
    )
    _plain_ticks(axes)
    axes.set_title("Least error of each structure, each at its own best", fontsize=11)
    figure.legend(fontsize=8, ncols=5, loc="outside upper center")
    figure.text(
        0.01, -0.02,
        f"Worst of the vehicle's corners and of all delays up to the one shown; noise on the wheel"
        f" at most {asked.noise_gain_rad_m_max:g} rad per m;\npeak sensitivity at most"
        f" {asked.peak_sensitivity_max:g}. Predictor: the shipped preset, which reads more signals"
        " and passes less noise.\nGrey: the paper's own gains, whatever noise they pass; its CDOB"
        " and DDOB drift off the path without a washout.",
        fontsize=7.5, color="0.35", va="top",
    )  # fmt: skip
    return figure


def draw_trials(rows: Sequence[Row]) -> Figure:
    """Draw six trials of the same designs."""
    figure = Figure(figsize=(12.0, 7.5))
    panels = figure.subplots(2, 3).ravel()
    shown: tuple[tuple[str, FigureOf], ...] = (
        (
            f"RMS with {_PER_MM * SENSOR_NOISE_M:g} mm of noise [mm]",
            lambda row: _PER_MM * row.trials.noisy_rms_m,
        ),
        (
            f"Peak after a side wind of {SIDE_FORCE_N:g} N [mm]",
            lambda row: _PER_MM * row.trials.wind_peak_m,
        ),
        (
            f"Left of a wheel offset of {STEERING_OFFSET_RAD:g} rad [mm]",
            lambda row: max(_LEFT_MM_MIN, _PER_MM * row.trials.offset_left_m),
        ),
        ("RMS with a wrong vehicle [mm]", lambda row: _PER_MM * row.trials.wrong_rms_m),
        (
            f"RMS with {100.0 * JITTER_SHARE:g} % of jitter, 95 % quantile [mm]",
            lambda row: _PER_MM * row.trials.jitter_95_m,
        ),
        (
            f"Stable up to [ms], with an unknown lag of {LAG_S:g} s",
            lambda row: row.point.lagged_ms,
        ),
    )
    for axes, (title, figure_of) in zip(panels, shown, strict=True):
        _lines(axes, rows, figure_of, is_named=axes is panels[0])
        axes.set_title(title, fontsize=9)
        axes.set(xlabel="guaranteed delay [ms]")
        if "Stable" not in title:
            axes.set_yscale("log")
            _plain_ticks(axes)
    figure.legend(fontsize=9, ncols=len(_LOOK), loc="outside lower center")
    return figure


def _marks(axes: Axes, rows: Sequence[Row]) -> None:
    """Mark the paper's own laws, in grey and not joined."""
    for taken, fill in ((PUBLISHED, "none"), (FILTERED, _GREY)):
        points = [row.point for row in rows if row.point.structure.startswith(f"{taken}: ")]
        held = [point for point in points if math.isfinite(point.rms_m)]
        axes.scatter(
            [point.delay_ms for point in held], [_PER_MM * point.rms_m for point in held], s=30,
            facecolors=fill, edgecolors=_GREY, label=taken, zorder=3,
        )  # fmt: skip
        for point in held:
            axes.annotate(
                point.structure.removeprefix(f"{taken}: "), (point.delay_ms, _PER_MM * point.rms_m),
                xytext=(0, 6 if taken == FILTERED else -12), textcoords="offset points",
                fontsize=7, color=_GREY, ha="left",
            )  # fmt: skip


def _plain_ticks(axes: Axes) -> None:
    """Write 10 and 0.1 in place of powers, and label only 1, 2 and 5 of a decade."""
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _place: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())


def _lines(axes: Axes, rows: Sequence[Row], figure_of: FigureOf, *, is_named: bool) -> None:
    for structure, (colour, style) in _LOOK.items():
        chosen = [row for row in rows if row.point.structure == structure]
        points = [(row.point.delay_ms, figure_of(row)) for row in chosen]
        held = [(x, y) for x, y in points if math.isfinite(y)]
        lost = [x for x, y in points if math.isinf(y)]
        axes.plot(
            [x for x, _ in held], [y for _, y in held], style, ms=4.5, color=colour,
            label=structure if is_named else None,
        )  # fmt: skip
        if lost:
            axes.plot(
                lost, [1.0] * len(lost), "x", ms=7, color=colour, clip_on=False,
                transform=axes.get_xaxis_transform(),
            )  # fmt: skip
