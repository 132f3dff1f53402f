"""The paper's future work: the runs of figures 21 to 24 with a delay that varies.

    constant    80 ms, as in the paper
    drawn       gamma, 80 ± 30 ms, anew for every command; the newest command wins
    wandering   the same distribution, the latencies correlated over 1 s
    profile     from 20 to 140 ms and back in 60 s

At 1 kHz a command is overtaken by whichever later one is faster. Of latencies drawn anew for every
command only the shortest come through, so that those in effect are much younger than 80 ms.
"""

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from ...pair.trace import rms
from ...reports.plot_style import COLOURS
from ...runtime.array_types import FloatArray
from . import published
from .delay_runs import (
    CDOB,
    DDOB,
    DURATION_S,
    FILTER,
    PD,
    SETTINGS_CAPTION,
    STEER_RAD_MAX,
    TYPE_2,
    WASHOUT,
    delayed_plant,
    drive,
    peak,
)
from .result import Comparison, Picture, Reproduction, Verdict
from .simulation import History, thinned

_STEP_S = 0.01
_LINE = "latency.downlink."
_GAMMA = (f"{_LINE}model=gamma", f"{_LINE}spread_s=0.03")
_PROFILE = "[{time_s=0,mean_s=0.02},{time_s=30,mean_s=0.14},{time_s=60,mean_s=0.02}]"
_COURSES: Mapping[str, tuple[str, ...]] = {
    "constant 80 ms": (),
    "80 ± 30 ms, drawn": _GAMMA,
    "80 ± 30 ms, wandering": (*_GAMMA, f"{_LINE}correlation_time_s=1"),
    "20 to 140 ms, profile": (f"{_LINE}schedule={_PROFILE}", f"{_LINE}schedule_shape=ramp"),
}
_LAWS = (
    PD.changed(*FILTER),
    CDOB.changed(*FILTER, *WASHOUT),
    DDOB.changed(*FILTER, *WASHOUT, *TYPE_2),
)


def figure_21_varying() -> Reproduction:
    """Return lateral deviation and steer of PD, PD+CDOB and DDOB under varying delay."""
    runs = {
        course: drive(_LAWS, delayed_plant(DURATION_S, *overrides))
        for course, overrides in _COURSES.items()
    }
    return Reproduction(
        "figure_21_varying",
        "Future work: varying delay",
        f"{SETTINGS_CAPTION} N = 30 rad/s; CDOB with washout ω_h = 3 rad/s, DDOB with the type-2 Q "
        "too. The latency of the commands varies: gamma with 30 ms standard deviation, drawn anew "
        "for every command (the newest wins, so that those in effect are younger than 80 ms) or "
        "correlated over 1 s; and as a profile.",
        (_picture(runs),),
        tuple(_comparison(course, by_law) for course, by_law in runs.items()),
        Verdict.BEYOND,
        "The paper announces varying delay for later. PD+CDOB and DDOB hold the path at the error "
        "they have with constant delay, however it varies. PD depends on what comes through: of "
        "latencies drawn for each command only the short ones do, and PD is stable; where they "
        "last, it goes from steering limit to limit for as long.",
    )


def _comparison(course: str, runs: Mapping[str, History]) -> Comparison:
    latency_s = next(iter(runs.values())).downlink_latency_s
    texts = [f"in effect {1e3 * float(np.nanmean(latency_s)):.0f} ms on average"]
    texts += [
        f"{label}: RMS {rms(run.lateral_error_m):.4f} m, peak steer {peak(run.wheel_angle_rad):.3f}"
        for label, run in runs.items()
    ]
    return Comparison(f"{course}, {DURATION_S:g} s", published.FUTURE_WORK, "; ".join(texts), None)


def _picture(runs: Mapping[str, Mapping[str, History]]) -> Picture:
    figure = Figure(figsize=(12.5, 7.5))
    grid = figure.subplots(3, len(runs), sharex=True, sharey="row")
    columns: dict[str, FloatArray] = {}
    for (course, by_law), (above, middle, below) in zip(runs.items(), grid.T, strict=True):
        for colour, (label, run) in zip(COLOURS, by_law.items(), strict=False):
            few = thinned(run, _STEP_S)
            columns["time_s"] = few.time_s
            columns[f"{course} downlink_latency_s"] = few.downlink_latency_s
            columns[f"{course}: {label} lateral_error_m"] = few.lateral_error_m
            columns[f"{course}: {label} wheel_angle_rad"] = few.wheel_angle_rad
            middle.plot(few.time_s, few.lateral_error_m, color=colour, lw=0.9, label=label)
            below.plot(few.time_s, few.wheel_angle_rad, color=colour, lw=0.7)
        above.plot(few.time_s, 1e3 * few.downlink_latency_s, color="0.3", lw=0.6)
        above.set_title(course, fontsize=10.5)
        below.set_xlabel("time [s]")
        for limit_rad in (-STEER_RAD_MAX, STEER_RAD_MAX):
            below.axhline(limit_rad, color="0.4", lw=0.8, ls=":")
    grid[0, 0].set_ylabel("latency in effect [ms]")
    grid[1, 0].set_ylabel("lateral deviation [m]")
    grid[2, 0].set_ylabel("steering angle [rad]")
    handles, labels = grid[1, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return Picture("figure_21_varying", figure, columns)
