"""Runs with delay for figures 21 to 24, laws and plant.

The paper's text gives the delay, 80 ms, and the cut-offs; all runs keep them. Two things are added,
one after the other, and named wherever they are:

    filter     C(s) = K_p + K_d s/(s/N + 1), N = 30 rad/s, instead of the ideal derivative. Every
               implementation has one. 30 rad/s lies between the N at which PD loses its stability
               at 80 ms and the one at which PD+CDOB does (17.8 and 54 rad/s).
               Elsewhere a CDOB makes no difference.
    washout    H = (s/(s + ω_h))² with ω_h = 3 rad/s on the CDOB's compensation, and with DDOB the
               type-2 Q in the DOB. They change the law; not in the paper.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ...closed_loop.pair.pair_result import rms
from ...controller.settings import controller_preset
from ...plant_emulator.settings import PlantSettings
from ...runtime.array_types import FloatArray
from .simulation import PAPER_DELAY_S, History, paper_plant, simulate

STEER_RAD_MAX = 0.6
"""Limit on every command, not in the paper: what a road vehicle's wheels can do."""

DURATION_S = 60.0

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

    @property
    def name(self) -> str:
        """Its name in the settings."""
        return self.preset.removeprefix("paper_")

    def changed(self, *overrides: str) -> "Law":
        """Return this law with further settings."""
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
