"""Runs with delay for figures 21 to 24, laws and plant; and the same with a delay that varies.

The paper's text gives the delay, 80 ms, and the cut-offs; all runs keep them. Two things are added,
one after the other, and named wherever they are:

    filter     C(s) = K_p + K_d s/(s/N + 1), N = 30 rad/s, instead of the ideal derivative. Every
               implementation has one. 30 rad/s lies between the N at which PD loses its stability
               at 80 ms and the one at which PD+CDOB does (17.8 and 54 rad/s).
               Elsewhere a CDOB makes no difference.
    washout    H = (s/(s + ω_h))² with ω_h = 3 rad/s on the CDOB's compensation, and with DDOB the
               type-2 Q in the DOB. They change the law; not in the paper.

A delay that varies is the paper's future work:

    constant    80 ms, as in the paper
    drawn       gamma, 80 ± 30 ms, anew for every command; the newest command wins
    wandering   the same distribution, the latencies correlated over 1 s
    profile     from 20 to 140 ms and back in 60 s

At 1 kHz a command is overtaken by whichever later one is faster. Of latencies drawn anew for every
command only the shortest come through, so that those in effect are much younger than 80 ms.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from ...closed_loop.pair_result import rms
from ...closed_loop.reports.plot_style import COLOURS
from ...controller.settings import controller_preset
from ...plant_emulator.path.ellipse_and_lane_changes import build_path
from ...plant_emulator.settings import PlantSettings
from ...runtime.array_types import FloatArray
from . import published
from .result import Comparison, Picture, Reproduction, Verdict
from .simulation import PAPER_DELAY_S, History, paper_plant, simulate, thinned

STEER_RAD_MAX = 0.6
"""Limit on every command, not in the paper: what a road vehicle's wheels can do."""

DURATION_S = 60.0
END_S = 5.0
"""The reported error at the end of a lap is the mean over this time."""

FILTER_RAD_S = 30.0
WASHOUT_RAD_S = 3.0
FILTER = (f"pd.derivative_filter_rad_s={FILTER_RAD_S}",)
WASHOUT = (f"cdob.washout_rad_s={WASHOUT_RAD_S}",)
TYPE_2 = ("dob.q_kind=type_2",)

SETTINGS_CAPTION = (
    "Nominal vehicle, 5 km/h, 2000 kg, C_r = 500,000 N/rad; 80 ms on the commands; K_p = 1.0596, "
    "K_d = 0.939; CDOB with ω_c = 200 rad/s, DOB with ω_c = 5 rad/s, both with G_n of (19) and Q "
    "of (20) unless stated otherwise; 1 kHz; steer limited to 0.6 rad; ellipse 78.2 m by 41.74 m."
)


class Law(NamedTuple):
    """A law as it is drawn: its name, a preset of the controller, and what is changed in it."""

    label: str
    preset: str
    overrides: tuple[str, ...] = ()

    def changed(self, *overrides: str) -> "Law":
        """Return the same law with further settings."""
        return self._replace(overrides=(*self.overrides, *overrides))


PD = Law("PD", "paper_pd")
CDOB = Law("PD+CDOB", "paper_pd_cdob")
DDOB = Law("DDOB", "paper_pd_ddob")


class Variant(NamedTuple):
    """What is changed in a pair of laws that are compared with each other."""

    title: str
    laws: tuple[Law, ...]


PD_AND_CDOB = (
    Variant("As published: ideal derivative", (PD, CDOB)),
    Variant("Filter N = 30 rad/s", (PD.changed(*FILTER), CDOB.changed(*FILTER))),
    Variant(
        "Filter and washout ω_h = 3 rad/s", (PD.changed(*FILTER), CDOB.changed(*FILTER, *WASHOUT))
    ),
)
CDOB_AND_DDOB = (
    Variant("As published: ideal derivative", (CDOB, DDOB)),
    Variant("Filter N = 30 rad/s", (CDOB.changed(*FILTER), DDOB.changed(*FILTER))),
    Variant(
        "Filter, washout 3 rad/s, type-2 Q",
        (CDOB.changed(*FILTER, *WASHOUT), DDOB.changed(*FILTER, *WASHOUT, *TYPE_2)),
    ),
)


class Compared(NamedTuple):
    """A variant and its runs, by the label of their law."""

    variant: Variant
    runs: Mapping[str, History]

    @property
    def pair(self) -> tuple[History, History]:
        """Return the run that the figure compares with, and the one that it prefers."""
        first, second = self.runs.values()
        return first, second


def compare(variants: Sequence[Variant]) -> list[Compared]:
    """Run every variant for DURATION_S."""
    plant = delayed_plant(DURATION_S)
    return [Compared(variant, drive(variant.laws, plant)) for variant in variants]


def delayed_plant(duration_s: float, *overrides: str) -> PlantSettings:
    """Return the nominal vehicle behind the paper's delay on the commands."""
    delay = f"latency.downlink.mean_s={PAPER_DELAY_S}"
    return paper_plant("paper_nominal", f"duration_s={duration_s}", delay, *overrides)


def drive(laws: Sequence[Law], plant: PlantSettings) -> dict[str, History]:
    """Return a run of each law."""
    return {
        law.label: simulate(plant, controller_preset(law.preset, law.overrides)) for law in laws
    }


def lap_s(plant: PlantSettings) -> float:
    """Return how long one lap takes [s]."""
    return build_path(plant.path).length_m / (plant.vehicle.speed_m_s)


def mean_before(run: History, time_s: float) -> float:
    """Return the mean lateral error over the END_S before a time [m]."""
    window = (run.time_s > time_s - END_S) & (run.time_s <= time_s)
    return float(np.mean(run.lateral_error_m[window]))


def peak(values: FloatArray) -> float:
    """Return the largest size of a column."""
    return float(np.max(np.abs(values)))


def error_text(run: History) -> str:
    """Return the lateral error of a run in a few words."""
    error_m = run.lateral_error_m
    return f"RMS {_metres(rms(error_m))}, peak {_metres(peak(error_m))}"


def steer_text(run: History) -> str:
    """Return the steer of a run in a few words."""
    return f"RMS {rms(run.wheel_angle_rad):.4f} rad, peak {peak(run.wheel_angle_rad):.3f} rad"


def _metres(value_m: float) -> str:
    return f"{value_m:.4f} m" if value_m < 1.0 else f"{value_m:.2f} m"


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
