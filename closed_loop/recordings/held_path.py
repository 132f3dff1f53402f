"""Figures of how well the path was held in a log, by the car's deviation or the measured error.

They count from the first command on.

The deviation of the centre of gravity (CG) from the path is in GROUND_TRUTH, where the plant sends
that. Otherwise it is computed. LATERAL_ERROR is of the preview point, d ahead of the CG, and so is
the curvature of VEHICLE_STATE. In the frame of the path at the preview point the CG is at
(-d cos Δψ, y - d sin Δψ), and the path there at d²/2 times its mean curvature on the way back,
weighted towards the preview point:

    y_cg = y - d sin Δψ - ρ d²/2        ρ as it was d/3 earlier

Both messages have come through the same uplink. What is left is of the third order: it
differs from the plant's own figure by a millimetre.

A plant judges its true error. Here the verdict is on the mean of the errors of SMOOTHED_S, as if
the sensor had no noise. It is on the preview point where the log does not tell where the car is.

Where CAR_TRUTH comes, the verdict names a grip that was used up before the lane was left, as a
plant's does (``plant_emulator.evaluation.grip_used``). A log tells neither lane nor body: both are
those of a plant that says nothing else, 3.5 m wide and a passenger car's.
"""

import math
from collections import deque
from collections.abc import Mapping
from typing import Any

from ...dbc import messages
from ...plant_emulator.evaluation.error_windows import WINDOW_SHARE_MAX
from ...plant_emulator.evaluation.grip_used import grip_step
from ...plant_emulator.evaluation.held_figures import HeldRules
from ...plant_emulator.evaluation.report_in_json import motion_report
from ...plant_emulator.evaluation.run_record import RunningFigures
from ...plant_emulator.evaluation.run_verdict import VerdictRules
from ...plant_emulator.path.corridor import beyond_lane_m
from ...plant_emulator.vehicle.car.settings import CarSettings
from ...runtime.node import NS_PER_S

SAMPLES_MAX = 31_000
"""Of the newest: two windows of 15 s at 1 kHz, and half a second on either side of them."""
SMOOTHED_S = 0.1
"""Ten samples at 100 Hz; an oscillation of 10 rad/s loses 4 % of its amplitude."""
KNOWN_SHARE = 0.9
"""Share of the measurements with which a log has to tell where the car is, for a verdict on it."""
_LIMITS = {
    messages.SteeringStatusCode.LIMITED_BY_SAFETY: "safety limit or fade",
    messages.SteeringStatusCode.LIMITED: "actuator",
}
_RULES = VerdictRules()
_LANE = CarSettings().lane


class HeldPath:
    """Takes the messages of a log in their order.

    ``preview_m``    where the preview point is, ahead of the centre of gravity
    ``has_started``  whether a command came
    """

    def __init__(self, preview_m: float) -> None:
        self._preview_m = preview_m
        self._heading_rad = self._error_m = self._curvature_1_m = math.nan
        self._grip_at_s = math.nan
        self._figures = RunningFigures(HeldRules(_RULES.settling_band_m), SAMPLES_MAX)
        """Of the preview point; ``_of_car`` has the same where the log tells where the car is."""
        self._of_car = RunningFigures(HeldRules(_RULES.settling_band_m), SAMPLES_MAX)
        self._recent: deque[tuple[float, float, float]] = deque()
        """Time, error and deviation of the car, of SMOOTHED_S; without times the newest only."""
        self.has_started = False
        self._wheel_rad = 0.0
        self._limit = ""
        self._first_s = math.nan

    @property
    def samples(self) -> int:
        """Measurements since the first command."""
        return self._figures.held.samples

    @property
    def can_be_judged(self) -> bool:
        """Whether the two windows at the end, each of a share of the samples, have any."""
        return int(self.samples * WINDOW_SHARE_MAX) > 1

    def on_message(self, message: messages.Message, at_s: float, cg_deviation_m: float) -> None:
        """Take an accepted message, and the centre of gravity's deviation by then, NaN for none.

        ``at_s``  its time; NaN in a log without times, whose error never counts as settled
        """
        if isinstance(message, messages.SteeringCommand):
            self.has_started = True
        elif isinstance(message, messages.SteeringStatus):
            self._wheel_rad = message.wheel_angle_rad
            self._limit = _LIMITS.get(message.status, "")
        elif isinstance(message, messages.LateralError) and self.has_started:
            self._error_m = error_m = message.lateral_error_m
            self._heading_rad = message.heading_error_rad
            if not self.samples:
                self._first_s = at_s
            is_settled = at_s - self._first_s >= _RULES.settled_s
            smoothed = self._smoothed(at_s, error_m, cg_deviation_m)
            for figures, judged_m in zip((self._figures, self._of_car), smoothed, strict=True):
                if is_settled and figures.rules.settled_after == math.inf:
                    figures.rules = figures.rules._replace(settled_after=figures.held.samples)
                if not math.isnan(judged_m):
                    figures.add(error_m, cg_deviation_m, judged_m, self._wheel_rad, self._limit)
        elif isinstance(message, messages.VehicleState):
            self._curvature_1_m = message.preview_curvature_1_m
            self._figures.stands = self._of_car.stands = message.speed_m_s == 0.0
        elif isinstance(message, messages.CarTruth) and at_s >= self._first_s:
            self._grip_at_s = at_s - self._first_s
            self._of_car.grip = grip_step(
                self._of_car.grip,
                self._grip_at_s,
                message.front_grip_used,
                message.rear_grip_used,
                self._beyond_lane_m(cg_deviation_m),
            )

    def _beyond_lane_m(self, cg_deviation_m: float) -> float:
        """Return how far a corner of the body is beyond its lane [m]; NaN for unknown."""
        rho, psi, rear_m = self._curvature_1_m, self._heading_rad, _LANE.rear_m
        turn_rad = psi + rho * self._preview_m
        rear_end_m = cg_deviation_m - rear_m * math.sin(turn_rad) - 0.5 * rho * rear_m * rear_m
        return float(beyond_lane_m(_LANE, self._preview_m, psi, self._error_m, rho, rear_end_m))

    def _smoothed(self, at_s: float, error_m: float, cg_m: float) -> tuple[float, float]:
        recent = self._recent
        recent.append((at_s, error_m, cg_m))
        while len(recent) > 1 and not at_s - recent[0][0] < SMOOTHED_S:
            recent.popleft()
        _, errors_m, cgs_m = zip(*recent, strict=True)
        return sum(errors_m) / len(recent), sum(cgs_m) / len(recent)

    def report(self, period_s: float, *, left_range: bool, is_driven: bool) -> Mapping[str, Any]:
        """Return the figures as a plant reports them.

        ``period_s``    between two measurements
        ``left_range``  whether an error was beyond the range of its signal
        ``is_driven``   whether the plant applied a command, as far as the log tells
        """
        figures, rules = self._of_car, _RULES
        if self._of_car.held.samples < KNOWN_SHARE * self.samples:
            figures, rules = self._figures, VerdictRules(judged_point="preview")
        if left_range and figures.held.samples:
            figures.held = figures.held._replace(preview_peak_m=math.inf)
            figures.left_path_s = self._grip_at_s
        motion_ns = round(figures.held.samples * period_s * NS_PER_S)
        return motion_report(figures, motion_ns, rules, 0.0, period_s, is_driven)


PREVIEW_M = 2.0
"""Where the wire contract has the preview point, ahead of the CG."""
_KEPT = 4096
"""States kept: at 50 Hz more than a minute, which slow vehicles take for d/3."""


class CgDeviation:
    """Takes the messages of a plant, and returns the deviations that they bring.

    ``preview_m``  d
    """

    def __init__(self, preview_m: float) -> None:
        self._preview_m = preview_m
        self._driven: deque[tuple[float, float]] = deque(maxlen=_KEPT)
        self._at_s = math.nan
        self._is_sent = False

    def on_message(self, message: messages.Message, at_s: float) -> float:
        """Take an accepted message, ``at_s`` NaN where there are no times.

        Returns the deviation that it brings [m], to the left positive; NaN for none.
        """
        if isinstance(message, messages.GroundTruth):
            self._is_sent = True
            return message.cg_deviation_m
        if self._is_sent or math.isnan(at_s):
            return math.nan
        if isinstance(message, messages.VehicleState):
            self._drive(message, at_s)
        elif isinstance(message, messages.LateralError) and self._driven:
            return self._computed(message)
        return math.nan

    def _drive(self, state: messages.VehicleState, at_s: float) -> None:
        way_m = self._driven[-1][0] if self._driven else 0.0
        if at_s > self._at_s:
            way_m += state.speed_m_s * (at_s - self._at_s)
        self._at_s = at_s
        self._driven.append((way_m, state.preview_curvature_1_m))

    def _computed(self, error: messages.LateralError) -> float:
        behind_m = self._driven[-1][0] - self._preview_m / 3.0
        while len(self._driven) > 1 and self._driven[1][0] <= behind_m:
            self._driven.popleft()
        curvature_1_m = self._driven[0][1]
        return (
            error.lateral_error_m
            - self._preview_m * math.sin(error.heading_error_rad)
            - 0.5 * self._preview_m * self._preview_m * curvature_1_m
        )
