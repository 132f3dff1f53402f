"""Pictures of the demo: lateral error beside the latency, steering, and the path from above."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...closed_loop.pair.pair_result import Trace
from ...closed_loop.reports.plot_style import COLOURS, plot_style
from ...runtime.array_types import FloatArray
from .laws_and_phases import LawResult, Phase

RUNNING_S = 1.0
"""Over which the error's running RMS is taken."""
SHOWN_MM = (0.5, 2000.0)
"""The ends of the error's axis; beyond them a car is lost."""


def draw_all(results: Sequence[LawResult], phases: Sequence[Phase], folder: Path) -> list[Path]:
    """Draw the three pictures into ``folder``; returns their paths."""
    with plot_style():
        figures = {
            folder / "lateral_error.png": draw_lateral_error(results, phases),
            folder / "steering.png": draw_steering(results, phases),
            folder / "path_from_above.png": draw_path(results),
        }
        for path, figure in figures.items():
            figure.savefig(path)
    return list(figures)


def draw_lateral_error(results: Sequence[LawResult], phases: Sequence[Phase]) -> Figure:
    """Running RMS of the car's deviation over time, and below the latency that all laws meet."""
    figure = Figure(figsize=(9.0, 6.5))
    error, latency = figure.subplots(2, 1, sharex=True, height_ratios=(3.0, 1.0))
    for colour, result in zip(COLOURS, results, strict=False):
        for trace, style in (
            (result.live.trace, {"color": colour, "lw": 2.0, "label": result.label}),
            (result.virtual.trace, {"color": "black", "lw": 0.8, "ls": ":"}),
        ):
            error.plot(trace.time_s, running_rms_mm(trace, trace.cg_deviation_m), **style)
    error.plot([], [], color="black", lw=0.8, ls=":", label="the same in virtual time")
    error.set(
        yscale="log", ylim=SHOWN_MM, ylabel=f"deviation of the car,\nRMS over {RUNNING_S:g} s [mm]"
    )
    error.set_title("Who holds the path when the commands come late", pad=22.0)
    trace = results[-1].live.trace
    latency.plot(trace.time_s, 1e3 * trace.downlink_latency_s, ".", ms=2.0, color="0.25")
    latency.set(xlabel="time [s]", ylabel="latency [ms]", ylim=(0.0, None))
    for axes in (error, latency):
        mark_phases(axes, phases, is_named=axes is error)
    figure.legend(loc="outside lower center", ncols=3)
    return figure


def draw_steering(results: Sequence[LawResult], phases: Sequence[Phase]) -> Figure:
    """Front wheel angle over time, one row a law, on one scale."""
    figure = Figure(figsize=(9.0, 1.7 * len(results) + 1.0))
    rows = np.atleast_1d(figure.subplots(len(results), 1, sharex=True, sharey=True))
    for colour, result, axes in zip(COLOURS, results, rows, strict=False):
        trace = result.live.trace
        axes.plot(trace.time_s, trace.wheel_angle_rad, color=colour, lw=1.0)
        axes.set_title(result.label, fontsize=10, pad=16.0 if axes is rows[0] else None)
        limit_rad = result.live.controller["settings"]["limits"]["steer_rad_max"]
        for side in (-limit_rad, limit_rad):
            axes.axhline(side, color="black", lw=0.8, ls="--")
        mark_phases(axes, phases, is_named=axes is rows[0])
    rows[-1].set_xlabel("time [s]")
    figure.supylabel("front wheel angle [rad]; dashed: the controller's limit", fontsize=10)
    return figure


def draw_path(results: Sequence[LawResult]) -> Figure:
    """Tracks of the cars from above, their deviation from the path drawn larger than it is."""
    held = (phase.peak_m for one in results for phase in one.live_phases if phase.holds)
    peak_m = max(held, default=1.0)
    first = results[0].live.trace
    path_x_m, path_y_m = first.path_x_m, first.path_y_m
    width_m, height_m = float(np.ptp(path_x_m)), float(np.ptp(path_y_m))
    factor = nice_factor(0.12 * max(width_m, height_m) / max(peak_m, 1e-9))
    figure = Figure(figsize=(9.0, min(max(8.0 * height_m / width_m, 3.0), 8.0) + 1.2))
    axes = figure.subplots()
    axes.plot(path_x_m, path_y_m, color="black", lw=1.0, ls="--", label="path")
    for colour, result in zip(COLOURS, results, strict=False):
        axes.plot(*magnified_track(result.live.trace, factor), color=colour, label=result.label)
    axes.plot(path_x_m[0], path_y_m[0], "o", color="black", ms=6)
    axes.annotate(
        "start",
        (path_x_m[0], path_y_m[0]),
        xytext=(-12, 0),
        textcoords="offset points",
        ha="right",
        va="center",
    )
    axes.set_aspect("equal")
    axes.set(xlabel="x [m]", ylabel="y [m]")
    room_m = 0.2 * height_m  # a lost car leaves the picture
    axes.set_xlim(path_x_m.min() - room_m, path_x_m.max() + room_m)
    axes.set_ylim(path_y_m.min() - room_m, path_y_m.max() + room_m)
    magnified = "" if factor == 1 else f", deviations {factor:g} times as large"
    axes.set_title(f"The path and the cars from above{magnified}")
    figure.legend(loc="outside lower center", ncols=5)
    return figure


def magnified_track(trace: Trace, factor: float) -> tuple[FloatArray, FloatArray]:
    """Return x and y of a car whose deviation to the left of the path is so many times as large."""
    along_x, along_y = np.gradient(trace.path_x_m), np.gradient(trace.path_y_m)
    reach_m = factor * trace.cg_deviation_m / np.maximum(np.hypot(along_x, along_y), 1e-12)
    return trace.path_x_m - reach_m * along_y, trace.path_y_m + reach_m * along_x


def mark_phases(axes: Axes, phases: Sequence[Phase], *, is_named: bool) -> None:
    """Mark where phases begin, and name them above the axes."""
    for phase in phases:
        if phase.from_s:
            axes.axvline(phase.from_s, color="0.35", lw=0.9)
        if is_named:
            axes.text(
                0.5 * (phase.from_s + phase.to_s),
                1.02,
                phase.title,
                transform=axes.get_xaxis_transform(),
                ha="center",
                va="bottom",
                fontsize=9.5,
            )
    axes.set_xlim(phases[0].from_s, phases[-1].to_s)


def running_rms_mm(trace: Trace, deviation_m: FloatArray) -> FloatArray:
    """Return the RMS of a deviation over the last RUNNING_S, or since the start [mm]."""
    squares = np.concatenate(([0.0], np.cumsum(np.square(1e3 * deviation_m))))
    last = np.arange(1, len(squares))
    first = np.searchsorted(trace.time_s, trace.time_s - RUNNING_S)
    mean = (squares[last] - squares[first]) / (last - first)
    return np.asarray(np.sqrt(np.maximum(mean, 0.0)), dtype=np.float64)


def nice_factor(wanted: float) -> float:
    """Round down to 1, 2 or 5 times a power of ten, at least 1."""
    if wanted <= 1.0:
        return 1.0
    decade = 10.0 ** np.floor(np.log10(wanted))
    return float(max(step * decade for step in (1.0, 2.0, 5.0) if step * decade <= wanted))
