"""How well the path was held in a log, by the measured lateral error from the first command on."""

import math
from collections.abc import Mapping
from typing import Any

from ..dbc.messages import (
    LateralError,
    Message,
    SteeringCommand,
    SteeringStatus,
    SteeringStatusCode,
)
from ..plant_emulator.plant_report import motion_report
from ..plant_emulator.plant_samples import RunningFigures
from ..plant_emulator.verdict import VerdictRules
from ..runtime.node import NS_PER_S

SAMPLES_MAX = 30_000
"""Of the newest: two windows of 15 s at 1 kHz."""
_LIMITS = {
    SteeringStatusCode.LIMITED_BY_SAFETY: "safety limit or fade",
    SteeringStatusCode.LIMITED: "actuator",
}


class HeldPath:
    """Takes the messages of a log in their order; ``rules`` are those of the verdict."""

    def __init__(self, rules: VerdictRules) -> None:
        self._rules = rules
        self._figures = RunningFigures(rules.settling_band_m, SAMPLES_MAX)
        self._has_started = False
        self._wheel_rad = 0.0
        self._limit = ""

    def take(self, message: Message, cg_deviation_m: float) -> None:
        """Take an accepted message, and the centre of gravity's deviation by then, NaN for none."""
        if isinstance(message, SteeringCommand):
            self._has_started = True
        elif isinstance(message, SteeringStatus):
            self._wheel_rad = message.wheel_angle_rad
            self._limit = _LIMITS.get(message.status, "")
        elif isinstance(message, LateralError) and self._has_started:
            self._figures.take(
                message.lateral_error_m, cg_deviation_m, self._wheel_rad, self._limit
            )

    def report(self, period_s: float, *, left_range: bool) -> Mapping[str, Any]:
        """Return the figures as a plant reports them.

        ``period_s``    between two measurements
        ``left_range``  whether an error was beyond the range of its signal
        """
        figures = self._figures
        if left_range and figures.samples:
            figures.lateral_error_peak_m = math.inf
        return motion_report(
            figures, round(figures.samples * period_s * NS_PER_S), self._rules, period_s
        )
