"""What becomes of a run, told from its figures alone (``tools.stress.figures``).

The first that applies:

    no start      no measurement ever reached the controller
    left range    the error went beyond what LATERAL_ERROR can carry (±83.88 m)
    unstable      the law gave no finite command; or an oscillation grows: its amplitude in the last
                  window is ``growth`` times that in the window before, or more
    limit cycle   an oscillation lasts: its amplitude is at least ``sustained`` times that before
    drifts        the mean of the last window is farther from the path than that of the window
                  before, moves away at ``drift_m_s`` or faster, and is beyond ``drift_m``
    holds         none of these

An oscillation has an amplitude of ``amplitude_m`` or more, and half periods whose standard
deviation is at most ``irregularity`` of their mean; one that a disturbance has struck and that dies
away is none. A loop that is unstable in the linear sense meets the limits of its commands sooner or
later and then goes round in a limit cycle: both verdicts mean that it does not hold.
"""

from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from controller.settings import ControllerSettings
from plant_emulator.settings import PlantSettings
from runtime.settings import Settings
from tools.stress.figures import FigureRules, Figures, figure_rules

FloatArray = NDArray[np.float64]


class Verdict(StrEnum):
    """What becomes of a run."""

    NO_START = "no start"
    LEFT_RANGE = "left range"
    UNSTABLE = "unstable"
    LIMIT_CYCLE = "limit cycle"
    DRIFTS = "drifts"
    HOLDS = "holds"


class RunEnd(StrEnum):
    """How a run ended; the number of an end is its place in this list."""

    COMPLETE = "complete"
    LEFT_RANGE = "left range"
    LAW_FAILED = "law failed"
    NO_START = "no start"


RUN_ENDS = tuple(RunEnd)


class VerdictRules(Settings):
    """``[verdict]``: thresholds; what is not set is as here."""

    window_s: float = Field(15.0, gt=0.0, le=10_000.0)
    """Of each of the two windows at the end of a run; at most a quarter of it."""
    settling_band_m: float = Field(0.1, gt=0.0, le=100.0)
    amplitude_m: float = Field(0.02, gt=0.0, le=100.0)
    growth: float = Field(1.5, gt=1.0, le=1000.0)
    sustained: float = Field(0.8, gt=0.0, le=1.0)
    irregularity: float = Field(0.4, gt=0.0, le=10.0)
    drift_m: float = Field(0.25, gt=0.0, le=100.0)
    drift_m_s: float = Field(0.005, gt=0.0, le=100.0)


def rules_of(
    rules: VerdictRules, plant: PlantSettings, controller: ControllerSettings
) -> FigureRules:
    """Return what the figures of a run of these settings are taken with."""
    return figure_rules(plant, controller, rules.window_s, rules.settling_band_m)


def verdicts(rules: VerdictRules, ends: NDArray[np.int64], figures: FloatArray) -> list[Verdict]:
    """Return the verdict of each run.

    ``ends``     shape (runs,), places in ``RUN_ENDS``
    ``figures``  shape (runs, figures), in the order of ``Figures``
    """

    def column(name: str) -> Any:
        return figures[:, Figures._fields.index(name)]

    def ended(end: RunEnd) -> Any:
        return ends == RUN_ENDS.index(end)

    amplitude_m, before_m = column("amplitude_m"), column("amplitude_before_m")
    # Comparisons with NaN are false: what has no figure has no such behaviour.
    oscillates = (amplitude_m >= rules.amplitude_m) & (column("irregularity") <= rules.irregularity)
    grows = oscillates & (amplitude_m >= rules.growth * before_m)
    lasts = oscillates & (amplitude_m >= rules.sustained * before_m)
    mean_m, drift_m_s = column("mean_m"), column("drift_m_s")
    drifts = (np.abs(mean_m) >= rules.drift_m) & (drift_m_s * np.sign(mean_m) >= rules.drift_m_s)
    conditions = {
        Verdict.NO_START: ended(RunEnd.NO_START),
        Verdict.LEFT_RANGE: ended(RunEnd.LEFT_RANGE),
        Verdict.UNSTABLE: ended(RunEnd.LAW_FAILED) | grows,
        Verdict.LIMIT_CYCLE: lasts,
        Verdict.DRIFTS: drifts,
    }
    names = list(conditions)
    chosen = np.select(list(conditions.values()), range(len(names)), default=len(names))
    return [(*names, Verdict.HOLDS)[place] for place in chosen.tolist()]
