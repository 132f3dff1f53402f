"""The verdicts on the runs of a study, from their figures."""

import numpy as np

from ...controller.settings import ControllerSettings
from ...plant_emulator.evaluation import run_verdict
from ...plant_emulator.evaluation.error_windows import WINDOW_SHARE_MAX, WindowFigures
from ...plant_emulator.evaluation.run_verdict import RUN_ENDS, RunEnd, Verdict, VerdictRules
from ...plant_emulator.settings import PlantSettings
from ...runtime.array_types import FloatArray, IntArray
from ...runtime.node import NS_PER_S
from .figures import FigureRules, Figures

_PEAK = Figures._fields.index("peak_m")
_WINDOWS = [Figures._fields.index(name) for name in WindowFigures._fields]


def rules_of(
    rules: VerdictRules, plant: PlantSettings, controller: ControllerSettings
) -> FigureRules:
    """Return the rules for the figures of a run of these settings."""
    limits = controller.steer_limits
    return FigureRules(
        plant.sensor_period_ns / NS_PER_S,
        controller.period_ns / NS_PER_S,
        limits.steer_rad_max,
        limits.step_rad_max,
        min(rules.window_s, WINDOW_SHARE_MAX * plant.duration_s),
        rules.settling_band_m,
    )


def short_windows(rules: VerdictRules, duration_s: float) -> str:
    """Return a warning for runs too short for the windows asked for; empty for others."""
    window_s = WINDOW_SHARE_MAX * duration_s
    if window_s >= rules.window_s:
        return ""
    return (
        f"runs of {duration_s:g} s are judged by two windows of {window_s:g} s, not of "
        f"verdict.window_s = {rules.window_s:g}: an oscillation of less than "
        f"{rules.swing_m:g} m is not seen if it is slower than {0.5 * window_s:g} s, nor growth "
        f"that takes longer; give plant.duration_s = {rules.window_s / WINDOW_SHARE_MAX:g} or more"
    )


def verdict_of(rules: VerdictRules, end: RunEnd, figures: FloatArray) -> Verdict:
    """Return the verdict of one run; ``figures`` begin in the order of ``Figures``."""
    return verdicts(rules, np.array([RUN_ENDS.index(end)]), figures[None])[0]


def verdicts(rules: VerdictRules, ends: IntArray, figures: FloatArray) -> list[Verdict]:
    """Return the verdict of each run.

    ``ends``     shape (runs,), places in ``RUN_ENDS``
    ``figures``  shape (runs, figures), in the order of ``Figures``
    """
    return run_verdict.verdicts(rules, ends, figures[:, _PEAK], figures[:, _WINDOWS])
