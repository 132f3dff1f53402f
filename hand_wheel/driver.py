"""Driver: arms that hold the wheel still, kicks of torque, and a two-point preview of the road.

The two-point driver wishes the angle (D. D. Salvucci and R. Gray, A two-point visual control model
of steering, Perception 33(10), 2004, integrated once)

    φ = k_f θ_f + k_n θ_n + ∫ k_I sat(θ_n) dt

after his reaction time, and his arms follow it through a neuromuscular lag and their impedance.

    θ_n, θ_f  angles at which he sees the middle of his path, near and far ahead [rad]

He sees what the bus brings of the path, LATERAL_ERROR and VEHICLE_STATE, as one who drives from
afar. While the law steers, he rests his hands, and his wish is the angle that the wheel has.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

from .wheel import GRIPS, Grip
from .wheel_step import Hands

HANDS_OFF = GRIPS["hands_off"]
NO_SIGHT = 0
"""Value of ``reaction`` for a driver who does not look at the road."""
ARMS_N_M_MAX = 15.0
"""Largest torque with which his arms follow his wish; chosen."""


class TwoPointParams(NamedTuple):
    """Constants of the two-point driver; gains as k_f, k_n and k_I above.

    ``near_rad_max``  limit of the saturation
    ``far_s``         time to the far point
    ``reaction``      reaction time in cycles, 1 or more; NO_SIGHT: he does not look
    ``kept``          e^(-T/T_N): what a cycle T leaves of the neuromuscular lag's error
    """

    far_gain: float
    near_gain: float
    integral_gain_1_s: float
    near_rad_max: float
    near_m: float
    far_s: float
    reaction: int
    kept: float


BLIND = TwoPointParams(0.0, 0.0, 0.0, 0.0, 1.0, 1.0, NO_SIGHT, 0.0)


class Kick(NamedTuple):
    """A torque, from one time to another."""

    from_ns: int
    to_ns: int
    torque_n_m: float


class DriverParams(NamedTuple):
    """How he holds the wheel, and what he looks at."""

    grip: Grip
    two_point: TwoPointParams
    cycle_s: float


class DriverState(NamedTuple):
    """Newest wish by sight, integral of θ_n, angle his arms aim at, and whether his hands rest."""

    by_sight_rad: float
    integral_rad: float
    wished_rad: float
    rests: bool


DRIVER_AT_REST = DriverState(0.0, 0.0, 0.0, False)


class Sight(NamedTuple):
    """What he sees: errors and curvature at the preview point, and the speed."""

    lateral_error_m: float
    heading_error_rad: float
    curvature_1_m: float
    speed_m_s: float
    preview_m: float


def kicks_n_m(kicks: Sequence[Kick], time_ns: Any) -> Any:
    """Return the torque of all kicks at a time, or at an array of times."""
    return sum(
        kick.torque_n_m * ((kick.from_ns <= time_ns) & (time_ns < kick.to_ns)) for kick in kicks
    )


def driver_step(
    p: DriverParams,
    x: DriverState,
    late_rad: float,
    sight: Sight,
    angle_rad: float,
    kick_n_m: float,
    holds: bool,
    steers: bool,
) -> tuple[DriverState, Hands]:
    """Return the state a cycle later, and what his hands do during this cycle.

    ``late_rad``   his wish by sight a reaction time ago
    ``angle_rad``  of the wheel, ``kick_n_m`` besides what his arms do
    ``holds``      whether his hands are on the wheel, ``steers``: whether he steers
    """
    two = p.two_point
    if two.reaction == NO_SIGHT:
        return x, Hands(p.grip if holds else HANDS_OFF, 0.0, 0.0, kick_n_m)
    far_m = max(two.far_s * sight.speed_m_s, two.near_m)
    near_rad, far_rad = _seen_rad(sight, two.near_m), _seen_rad(sight, far_m)
    by_sight_rad = two.far_gain * far_rad + two.near_gain * near_rad
    if not (holds and steers):
        rested = DriverState(angle_rad, angle_rad - by_sight_rad, angle_rad, True)
        return rested, Hands(HANDS_OFF, angle_rad, 0.0, kick_n_m)
    most_rad = two.near_rad_max
    rate = two.integral_gain_1_s * min(max(near_rad, -most_rad), most_rad)
    wished_rad = late_rad + two.kept * (x.wished_rad - late_rad)
    reach_rad = ARMS_N_M_MAX / max(p.grip.stiffness_n_m, 1e-3)
    wished_rad = min(max(wished_rad, angle_rad - reach_rad), angle_rad + reach_rad)
    hands = Hands(p.grip, x.wished_rad, (wished_rad - x.wished_rad) / p.cycle_s, kick_n_m)
    integral_rad = x.integral_rad + rate * p.cycle_s
    return DriverState(by_sight_rad + x.integral_rad, integral_rad, wished_rad, False), hands


def _seen_rad(sight: Sight, ahead_m: float) -> float:
    """Return the angle of a point of the path against the car's axis, left positive [rad].

    The path is continued from the preview point with the curvature there.
    """
    error_m, heading_rad, curvature_1_m, _, preview_m = sight
    beyond_m = ahead_m - preview_m
    return (beyond_m * (0.5 * curvature_1_m * beyond_m - heading_rad) - error_m) / ahead_m
