"""Driver: arms that hold the wheel still, kicks of torque, and a two-point preview of the road.

The two-point driver wishes the angle (D. D. Salvucci and R. Gray, A two-point visual control model
of steering, Perception 33(10), 2004, integrated once)

    φ = k_f θ_f + k_n θ_n + ∫ k_I sat(θ_n) dt

after his reaction time, and his arms follow it through a neuromuscular lag and their impedance.

    θ_n, θ_f  angles at which he sees the middle of his path, near and far ahead [rad]

He sees what the bus brings of the path, LATERAL_ERROR and VEHICLE_STATE, as one who drives from
afar. While the law steers, he rests his hands, and his wish is the angle that the wheel has.
"""

from typing import NamedTuple

from .wheel import GRIPS, Grip
from .wheel_step import Hands

HANDS_OFF = GRIPS["hands_off"]
ARMS_N_M_MAX = 15.0
"""Torque with which his arms follow his wish at most: chosen."""


class TwoPointParams(NamedTuple):
    """The symbols above.

    ``near_rad_max``  of the saturation
    ``near_m``        distance of the near point, ``far_s``: time to the far one
    ``reaction``      cycles of the reaction time, 1 or more
    ``kept``          share that a cycle leaves of the neuromuscular lag's lack
    """

    far_gain: float
    near_gain: float
    integral_gain_1_s: float
    near_rad_max: float
    near_m: float
    far_s: float
    reaction: int
    kept: float


class Kick(NamedTuple):
    """A torque, from one time to another."""

    from_ns: int
    to_ns: int
    torque_n_m: float


class DriverParams(NamedTuple):
    """``let_go_ns``: when he takes his hands off; ``two_point`` None: he wishes 0 for ever."""

    grip: Grip
    let_go_ns: int
    kicks: tuple[Kick, ...]
    two_point: TwoPointParams | None
    cycle_s: float


class DriverState(NamedTuple):
    """``seen``: wishes of the reaction time, oldest first; ``integral_rad`` of θ_n."""

    seen: tuple[float, ...]
    integral_rad: float
    wished_rad: float


class Sight(NamedTuple):
    """What he sees: errors and curvature at the preview point, and the speed."""

    lateral_error_m: float
    heading_error_rad: float
    curvature_1_m: float
    speed_m_s: float
    preview_m: float


def driver_at_rest(p: DriverParams) -> DriverState:
    """Return the state at the start."""
    return DriverState((0.0,) * (1 if p.two_point is None else p.two_point.reaction), 0.0, 0.0)


def driver_step(
    p: DriverParams, x: DriverState, sight: Sight, angle_rad: float, time_ns: int, steers: bool
) -> tuple[DriverState, Hands]:
    """Return the state a cycle later, and what his hands do during this cycle.

    ``angle_rad``  of the wheel
    ``steers``     whether he does
    """
    torque_n_m = sum(
        kick.torque_n_m for kick in p.kicks if kick.from_ns <= time_ns < kick.to_ns
    )  # fmt: skip
    is_off = time_ns >= p.let_go_ns
    two_point = p.two_point
    if two_point is None:
        return x, Hands(HANDS_OFF if is_off else p.grip, 0.0, 0.0, torque_n_m)
    near_rad, far_rad = seen_angles(two_point, sight)
    by_sight_rad = two_point.far_gain * far_rad + two_point.near_gain * near_rad
    if is_off or not steers:
        rested = DriverState((angle_rad,) * len(x.seen), angle_rad - by_sight_rad, angle_rad)
        return rested, Hands(HANDS_OFF, angle_rad, 0.0, torque_n_m)
    most_rad = two_point.near_rad_max
    rate = two_point.integral_gain_1_s * min(max(near_rad, -most_rad), most_rad)
    seen = (*x.seen[1:], by_sight_rad + x.integral_rad)
    wished_rad = x.seen[0] + two_point.kept * (x.wished_rad - x.seen[0])
    reach_rad = ARMS_N_M_MAX / max(p.grip.stiffness_n_m, 1e-3)
    wished_rad = min(max(wished_rad, angle_rad - reach_rad), angle_rad + reach_rad)
    hands = Hands(p.grip, x.wished_rad, (wished_rad - x.wished_rad) / p.cycle_s, torque_n_m)
    return DriverState(seen, x.integral_rad + rate * p.cycle_s, wished_rad), hands


def seen_angles(p: TwoPointParams, sight: Sight) -> tuple[float, float]:
    """Return the angles of the near and the far point against the car's axis, left positive [rad].

    The path is continued from the preview point with the curvature there.
    """
    error_m, heading_rad, curvature_1_m, speed_m_s, preview_m = sight
    angles = []
    for ahead_m in (p.near_m, max(p.far_s * speed_m_s, p.near_m)):
        beyond_m = ahead_m - preview_m
        across_m = beyond_m * (0.5 * curvature_1_m * beyond_m - heading_rad) - error_m
        angles.append(across_m / ahead_m)
    near_rad, far_rad = angles
    return near_rad, far_rad
