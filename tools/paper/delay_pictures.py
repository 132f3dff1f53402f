"""Pictures of runs with delay: variants side by side, and laps."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...closed_loop.pair_result import rms
from ...closed_loop.reports.plot_style import COLOURS
from ...runtime.array_types import FloatArray
from .delay_runs import STEER_RAD_MAX, Compared
from .result import Picture
from .simulation import History, thinned

LINEAR_M = 0.1
"""Up to here the scale of the error is linear; beyond, it is logarithmic."""

STEER_SHOWN_S = 10.0
"""Only the first seconds of the steer are drawn: later, a limit cycle is a filled area."""

_ERROR_STEP_S, _STEER_STEP_S, _LAP_STEP_S = 0.02, 0.005, 0.1
_COLUMN = {False: "lateral_error_m", True: "wheel_angle_rad"}
_COLOUR_OF = {
    "PD": COLOURS[0],
    "PD+CDOB": COLOURS[1],
    "PD+CDOB, washout": COLOURS[1],
    "PD+CDOB, no washout": "#56B4E9",
    "DDOB": COLOURS[2],
    "DDOB, washout, type-2 Q": COLOURS[2],
    "DDOB, washout": "#E69F00",
    "DDOB, no washout, type-2 Q": COLOURS[3],
    "DDOB, no washout": "0.4",
}
"""A law has one colour in all pictures."""


def panels(name: str, shown: Sequence[Compared], *, steer: bool) -> Picture:
    """Draw lateral errors, or steers, of several variants, on one scale."""
    figure = Figure(figsize=(12.0, 4.6))
    columns: dict[str, FloatArray] = {}
    for axes, (variant, runs) in zip(
        figure.subplots(1, len(shown), sharex=True, sharey=True), shown, strict=True
    ):
        for label, run in runs.items():
            few = _shown(run, steer)
            columns["time_s"] = few.time_s
            columns[f"{variant.title}: {label} {_COLUMN[steer]}"] = _values(few, steer)
            text = f"{label}, RMS {rms(_values(run, steer)):.3g} {'rad' if steer else 'm'}"
            axes.plot(few.time_s, _values(few, steer), color=_COLOUR_OF[label], lw=0.9, label=text)
        axes.set(xlabel="time [s]")
        axes.set_title(variant.title, fontsize=10.5)
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=1)
    _scale(figure.axes[0], steer)
    return Picture(name, figure, columns)


def two_laps(name: str, runs: Mapping[str, History], lap_s: float, *, steer: bool) -> Picture:
    """Draw two laps; runs may end earlier, their cells are then empty."""
    figure = Figure(figsize=(10.5, 5.0))
    axes = figure.subplots()
    few = {label: thinned(run, _LAP_STEP_S) for label, run in runs.items()}
    longest = max(few.values(), key=lambda run: run.time_s.size)
    columns = {"time_s": longest.time_s}
    for label, run in few.items():
        values = np.full(longest.time_s.size, np.nan)
        values[: run.time_s.size] = _values(run, steer)
        columns[f"{label} {_COLUMN[steer]}"] = values
        axes.plot(longest.time_s, values, color=_COLOUR_OF[label], lw=1.0, label=label)
    for lap in (1, 2):
        axes.axvline(lap * lap_s, color="0.4", lw=0.9, ls="-.")
        axes.annotate(
            f"end of lap {lap}",
            (lap * lap_s, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(-4, 2),
            textcoords="offset points",
            ha="right",
            fontsize=9,
            color="0.3",
        )
    axes.set(xlabel="time [s]")
    _scale(axes, steer)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=3)
    return Picture(name, figure, columns)


def _scale(axes: Axes, steer: bool) -> None:
    if steer:
        axes.set_ylabel("steering angle of the front wheels [rad]")
        if axes.dataLim.ymax > 0.9 * STEER_RAD_MAX:
            for limit_rad in (-STEER_RAD_MAX, STEER_RAD_MAX):
                axes.axhline(limit_rad, color="0.4", lw=0.8, ls=":")
    else:
        axes.set_yscale("symlog", linthresh=LINEAR_M, linscale=1.5)
        axes.set_ylabel("lateral deviation [m]")
    axes.axhline(0.0, color="black", lw=0.6)


def _shown(run: History, steer: bool) -> History:
    if not steer:
        return thinned(run, _ERROR_STEP_S)
    few = thinned(run, _STEER_STEP_S)
    return History(*(column[few.time_s <= STEER_SHOWN_S] for column in few))


def _values(run: History, steer: bool) -> FloatArray:
    return run.wheel_angle_rad if steer else run.lateral_error_m
