"""Pictures of the demo: lateral deviation, steer, latency, and the path seen from above."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...pair.trace import FloatArray, Trace, rms
from ...reports.plot_style import COLOURS, plot_style


class LawTraces(NamedTuple):
    """What is drawn of one law: the run on the bus and the same run in virtual time."""

    label: str
    live: Trace
    virtual: Trace


def draw_all(
    laws: Sequence[LawTraces],
    subtitle: str,
    steer_limit_rad: float,
    events: Mapping[float, str],
    folder: Path,
) -> list[Path]:
    """Draw the four pictures into ``folder``; returns their paths.

    ``events``  what else happens to the vehicle, by time [s]
    """
    with plot_style():
        figures = {
            "lateral_deviation": draw_lateral_deviation(laws, subtitle, events),
            "steer": draw_steer(laws, subtitle, steer_limit_rad),
            "latency": draw_latency(laws, subtitle),
            "path_from_above": draw_path(laws, subtitle),
        }
        paths = []
        for name, figure in figures.items():
            path = folder / f"{name}.png"
            figure.savefig(path)
            paths.append(path)
    return paths


def draw_lateral_deviation(
    laws: Sequence[LawTraces], subtitle: str, events: Mapping[float, str]
) -> Figure:
    """Lateral error at the preview point over time, and where its size was how often."""
    figure = Figure(figsize=(10.5, 4.6))
    left, right = figure.subplots(1, 2, width_ratios=(3.2, 1.0))
    for colour, law in zip(COLOURS, laws, strict=False):
        label = f"{law.label}, RMS {1e3 * rms(law.live.lateral_error_m):.1f} mm"
        left.plot(law.live.time_s, 1e3 * law.live.lateral_error_m, color=colour, label=label)
        draw_virtual(left, law.virtual.time_s, 1e3 * law.virtual.lateral_error_m)
        size_mm = 1e3 * np.sort(np.abs(law.live.lateral_error_m))
        right.plot(size_mm, np.linspace(0.0, 100.0, size_mm.size), color=colour)
    left.plot([], [], color="black", lw=0.8, ls=":", label="the same in virtual time")
    left.axhline(0.0, color="black", lw=0.6)
    for time_s, text in events.items():
        left.axvline(time_s, color="0.4", lw=0.9, ls="-.")
        left.annotate(
            text,
            (time_s, 0.97),
            xycoords=("data", "axes fraction"),
            xytext=(5, 0),
            textcoords="offset points",
            va="top",
            fontsize=9,
            color="0.3",
        )
    left.set(xlabel="time [s]", ylabel="lateral error at the preview point [mm]")
    left.set_title("Lateral deviation")
    left.legend(loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=2)
    right.set(xlabel="|lateral error| [mm]", ylabel="share of the run below [%]", ylim=(0.0, 100.0))
    right.set_xlim(left=0.0)
    figure.suptitle(subtitle, fontsize=9.5, color="0.35")
    return figure


def draw_steer(laws: Sequence[LawTraces], subtitle: str, steer_limit_rad: float) -> Figure:
    """Front wheel angle over time, one row a law, on one scale."""
    figure = Figure(figsize=(10.5, 1.9 * len(laws) + 0.9))
    rows = np.atleast_1d(figure.subplots(len(laws), 1, sharex=True, sharey=True))
    for colour, law, axes in zip(COLOURS, laws, rows, strict=False):
        axes.plot(law.live.time_s, law.live.wheel_angle_rad, color=colour, lw=1.2)
        draw_virtual(axes, law.virtual.time_s, law.virtual.wheel_angle_rad)
        peak_rad = float(np.max(np.abs(law.live.wheel_angle_rad)))
        axes.set_title(f"{law.label}: peak {peak_rad:.3f} rad", fontsize=10)
        axes.set_ylabel("wheel angle [rad]")
        if peak_rad > 0.9 * steer_limit_rad:
            for limit_rad in (-steer_limit_rad, steer_limit_rad):
                axes.axhline(limit_rad, color="black", lw=0.8, ls="--")
    rows[-1].set_xlabel("time [s]      (dotted: the same run in virtual time)")
    figure.suptitle(f"Steer.  {subtitle}", fontsize=9.5, color="0.35")
    return figure


def draw_latency(laws: Sequence[LawTraces], subtitle: str) -> Figure:
    """Latency of the command in effect by the time it takes effect, one row a law."""
    figure = Figure(figsize=(10.5, 1.7 * len(laws) + 1.3))
    grid = figure.subplots(
        len(laws), 2, sharex="col", sharey=True, width_ratios=(3.6, 1.0), squeeze=False
    )
    for colour, law, (left, right) in zip(COLOURS, laws, grid, strict=False):
        time_s, latency_ms = commands_in_effect(law.live)
        left.plot(time_s, latency_ms, ".", ms=3.0, color=colour)
        right.hist(latency_ms, bins=30, orientation="horizontal", color=colour, edgecolor="white")
        median_ms = float(np.median(latency_ms))
        for axes in (left, right):
            axes.axhline(median_ms, color="black", lw=0.9, ls="--")
        left.set_title(f"{law.label}: median {median_ms:.0f} ms", fontsize=10)
        left.set(ylabel="latency [ms]", ylim=(0.0, None))
    grid[-1, 0].set_xlabel("time [s]")
    grid[-1, 1].set_xlabel("commands")
    figure.suptitle(
        f"Latency of the command in effect at the wheel.  {subtitle}\n"
        "the newest command wins: late ones are overtaken, so that those in effect are younger",
        fontsize=9.5,
        color="0.35",
    )
    return figure


def commands_in_effect(trace: Trace) -> tuple[FloatArray, FloatArray]:
    """Return time [s] and latency [ms] of each command once, when the sensors first see it act."""
    latency_ms = 1e3 * trace.downlink_latency_s
    is_new = np.isfinite(latency_ms) & (np.diff(latency_ms, prepend=np.nan) != 0.0)
    return trace.time_s[is_new], latency_ms[is_new]


def draw_path(laws: Sequence[LawTraces], subtitle: str) -> Figure:
    """Tracks seen from above, the deviation from the path drawn larger than it is."""
    peak_m = max(float(np.max(np.abs(law.live.lateral_error_m))) for law in laws)
    path_x_m, path_y_m = laws[0].live.path_x_m, laws[0].live.path_y_m
    extent_m = max(float(np.ptp(path_x_m)), float(np.ptp(path_y_m)))
    factor = nice_factor(0.06 * extent_m / max(peak_m, 1e-9))
    width_m, height_m = float(np.ptp(path_x_m)), float(np.ptp(path_y_m))
    figure = Figure(figsize=(10.0, min(max(9.0 * height_m / width_m, 3.0), 9.0) + 1.6))
    axes = figure.subplots()
    axes.plot(path_x_m, path_y_m, color="black", lw=1.0, ls="--", label="path")
    for colour, law in zip(COLOURS, laws, strict=False):
        trace = law.live
        axes.plot(
            trace.path_x_m + factor * (trace.x_m - trace.path_x_m),
            trace.path_y_m + factor * (trace.y_m - trace.path_y_m),
            color=colour,
            label=law.label,
        )
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
    axes.margins(0.05)
    axes.set(xlabel="x [m]", ylabel="y [m]")
    magnified = "" if factor == 1 else f", deviation drawn {factor:g} times as large"
    axes.set_title(f"Path seen from above{magnified}")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=4)
    figure.suptitle(subtitle, fontsize=9.5, color="0.35")
    return figure


def draw_virtual(axes: Axes, time_s: FloatArray, values: FloatArray) -> None:
    """Draw a virtual-time trace over the live one."""
    axes.plot(time_s, values, color="black", lw=0.8, ls=":")


def nice_factor(wanted: float) -> float:
    """Round down to 1, 2 or 5 times a power of ten, at least 1."""
    if wanted <= 1.0:
        return 1.0
    decade = 10.0 ** np.floor(np.log10(wanted))
    return float(max(step * decade for step in (1.0, 2.0, 5.0) if step * decade <= wanted))
