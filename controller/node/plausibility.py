"""Plausibility of the plant's signals: contradictions between them that no CRC can show.

Each residual compares what two signals say of one motion, and forgets in FORGETS_S:

    heading   Δψ' - (r - V ρ)                 curvature or yaw rate wrong, speed wrong
    lateral   y' - (V Δψ + V β + l_s r)       lateral or heading error wrong, speed wrong
    behind    the same, with V β of a vehicle that steers at the rear
    yaw       r - V δ/(L + K V²)              wheel angle or speed wrong
    command   δ - u                           the wheel does not do what the echo names

with SAE 2018-01-1086 (1), the steady V β = (l_r - m l_f V²/(c_r L)) r and the understeer gradient K
of the nominal vehicle; one that steers at the rear has V β = -(l_f + m l_r V²/(c_f L)) r. Which of
the two it is never changes, and no signal tells. So the lateral error counts only from when the
motion has shown that it is not steered at the rear. Only the heading is compared without a vehicle,
and the command only for a law that sends no plans.

A residual is implausible beyond its floor, which noise and side wind reach, plus a share of all
that moved, which other vehicles reach; the signals are so once they have been for DEBOUNCE_S longer
than they have not. What moves too little to show is not found, and does little harm.

The means of all VEHICLE_STATE since the last judgement are judged with the controller's status.
"""

from collections.abc import Sequence
from math import exp
from typing import NamedTuple

from ...dbc.messages import VehicleState
from ..filters.nominal_model import NominalVehicle, understeer_gradient_s2_m
from ..filters.settings import VehicleModelSettings
from ..settings import ControllerSettings

FORGETS_S = 1.0
DEBOUNCE_S = 1.0


class Bound(NamedTuple):
    """Floor, in the unit of the residual times seconds, and share of what moved."""

    floor: float
    share: float


BOUNDS = {
    "heading": Bound(0.02, 0.1),  # rad
    "lateral": Bound(0.05, 0.15),  # m
    "behind": Bound(0.05, 0.15),  # m
    "yaw": Bound(0.1, 0.3),  # rad
    "command": Bound(0.01, 0.08),  # rad s
}
_IN_WORDS = {
    "heading": "heading error, yaw rate, speed and curvature contradict each other",
    "lateral": "lateral error, heading error, yaw rate and speed contradict each other",
    "yaw": "yaw rate, wheel angle and speed contradict each other",
    "command": "the wheel angle is not that of the command in effect",
}


def nominal_vehicle(settings: ControllerSettings) -> NominalVehicle | None:
    """Return the vehicle of the settings; None where there is only its transfer function."""
    model = settings.nominal_model
    return model.vehicle if isinstance(model, VehicleModelSettings) else None


class Motion(NamedTuple):
    """Means since the last judgement, and how long that is.

    ``along_m_s``  V Δψ
    ``turn_rad_s`` V ρ
    """

    lasted_s: float
    speed_m_s: float
    yaw_rate_rad_s: float
    turn_rad_s: float
    along_m_s: float
    wheel_rad: float
    command_rad: float


Reported = tuple[VehicleState, float, float, float]
"""A VEHICLE_STATE, and the newest heading error, wheel angle and command in effect [rad]."""


def mean_motion(reported: Sequence[Reported], lasted_s: float) -> Motion:
    """Return the means of what was reported, one or more, in ``lasted_s``."""
    a = b = c = d = e = f = 0.0
    for state, heading_rad, wheel_rad, command_rad in reported:
        v, r, rho = state.speed_m_s, state.yaw_rate_rad_s, state.preview_curvature_1_m
        a, b, c, d = a + v, b + r, c + v * rho, d + v * heading_rad
        e, f = e + wheel_rad, f + command_rad
    n = len(reported)
    return Motion(lasted_s, a / n, b / n, c / n, d / n, e / n, f / n)


class Plausibility:
    """Judges the signals; ``contradiction`` is what is wrong with them, once that is known.

    ``vehicle``   the nominal one, None if unknown
    ``has_plans`` whether the commands are sent as plans
    """

    def __init__(self, vehicle: NominalVehicle | None, *, has_plans: bool) -> None:
        self._vehicle = vehicle
        by_vehicle = () if vehicle is None else ("lateral", "behind", "yaw")
        self._names = ("heading", *by_vehicle, *(() if has_plans else ("command",)))
        self.contradiction = ""
        self._may_steer_behind = vehicle is not None
        self.restart()

    def restart(self) -> None:
        """Forget all residuals, as after a message that was missing."""
        self._before: tuple[float, float] | None = None
        self.residuals = dict.fromkeys(self._names, (0.0, 0.0))
        self._beyond_s = dict.fromkeys(self._names, 0.0)

    def step(self, motion: Motion, lateral_error_m: float, heading_error_rad: float) -> None:
        """Judge the motion since the last step by the newest errors."""
        before, self._before = self._before, (lateral_error_m, heading_error_rad)
        if before is None:
            return
        kept = exp(-motion.lasted_s / FORGETS_S)
        moved = self._moved(motion, lateral_error_m - before[0], heading_error_rad - before[1])
        residuals, beyond_s = self.residuals, self._beyond_s
        for name in self._names:
            one, other = moved[name]
            residual, activity = residuals[name]
            residual = kept * (residual + one - other)
            activity = kept * (activity + abs(one) + abs(other))
            residuals[name] = residual, activity
            floor, share = BOUNDS[name]
            is_beyond = abs(residual) > floor + share * activity
            if name == "behind":
                self._may_steer_behind &= not is_beyond
            elif is_beyond:
                beyond_s[name] += motion.lasted_s
            elif beyond_s[name]:
                beyond_s[name] = max(beyond_s[name] - motion.lasted_s, 0.0)
        for name, lasted_s in beyond_s.items():
            excused = name == "lateral" and self._may_steer_behind
            if lasted_s >= DEBOUNCE_S and not excused and not self.contradiction:
                self.contradiction = _IN_WORDS[name]

    def _moved(
        self, motion: Motion, error_m: float, heading_rad: float
    ) -> dict[str, tuple[float, float]]:
        """Return by residual how far it moved by either signal."""
        lasted_s, v, r, turn, along, wheel_rad, command_rad = motion
        moved = {
            "heading": (heading_rad + turn * lasted_s, r * lasted_s),
            "command": (wheel_rad * lasted_s, command_rad * lasted_s),
        }
        if self._vehicle is not None:
            m, _, c_f, c_r, l_f, l_r, l_s, _ = self._vehicle
            length = l_f + l_r
            side_m = l_r - m * l_f * v * v / (c_r * length)
            rear_m = -l_f - m * l_r * v * v / (c_f * length)
            steer_m = length + understeer_gradient_s2_m(self._vehicle) * v * v
            moved["lateral"] = (error_m - along * lasted_s, (side_m + l_s) * r * lasted_s)
            moved["behind"] = (error_m - along * lasted_s, (rear_m + l_s) * r * lasted_s)
            moved["yaw"] = (r * lasted_s, v * wheel_rad / steer_m * lasted_s)
        return moved
