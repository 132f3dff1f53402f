"""Signals of a minute whose figures and verdicts are known beforehand."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from steer_by_wire.closed_loop.studies.compiled_figures import Figures, figures_of, verdicts
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.plant_emulator.evaluation.run_verdict import (
    RUN_ENDS,
    RunEnd,
    Verdict,
    VerdictRules,
)
from steer_by_wire.plant_emulator.settings import PlantSettings

FloatArray = NDArray[np.floating[Any]]
LIMITS = ["limits.steer_rad_max=0.6", "limits.steer_rate_rad_s_max=2.0"]
RULES = VerdictRules(), PlantSettings(duration_s=60.0), controller_preset("practical_pd", LIMITS)
TIME_S: FloatArray = np.arange(6001, dtype=np.float64) * 0.01
NO_COMMANDS: FloatArray = np.zeros(0)


def figures(
    error_m: FloatArray, sent_rad: FloatArray = NO_COMMANDS, wheel_rad: FloatArray | None = None
) -> Figures:
    """Return the figures of the car's deviation; the preview point stays on the path."""
    wheel_rad = np.zeros(len(error_m)) if wheel_rad is None else wheel_rad
    moved = TIME_S[: len(error_m)], np.zeros(len(error_m)), error_m, error_m
    return figures_of(*RULES, *moved, wheel_rad, sent_rad)


def verdict(found: Figures, end: RunEnd = RunEnd.COMPLETE) -> Verdict:
    ends = np.array([RUN_ENDS.index(end)])
    return verdicts(VerdictRules(), ends, np.array([found], dtype=np.float64))[0]


def sine(amplitude_m: float, omega_rad_s: float, growth_1_s: float = 0.0) -> FloatArray:
    wave: FloatArray = np.exp(growth_1_s * TIME_S) * np.sin(omega_rad_s * TIME_S + 0.3)
    return amplitude_m * wave


def noise(spread_m: float) -> FloatArray:
    return np.random.default_rng(7).normal(0.0, spread_m, len(TIME_S))
