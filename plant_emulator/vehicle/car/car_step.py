"""The car: a nonlinear single track, its path, and one step of both.

    m (u̇ − v r) = F_xf cos δ − F_yf sin δ + F_xr − c_d u² − c_r m g        u ≥ 0
    m (v̇ + u r) = F_xf sin δ + F_yf cos δ + F_yr + F
    J ṙ         = l_f (F_xf sin δ + F_yf cos δ) − l_r F_yr + M
    ṡ  = (u cos Δψ − (v + l_s r) sin Δψ)/(1 − ρ y)
    ẏ  =  u sin Δψ + (v + l_s r) cos Δψ
    Δψ̇ = r − ρ ṡ
    F_zf = (m g l_r − m a_x h)/L,   F_zr = (m g l_f + m a_x h)/L

    u, v  speed of the centre of gravity (CG) along the car's axis, and across to the left  [m/s]
    r     yaw rate                                                                       [rad/s]
    δ     angle of the front wheels, steering offset included                              [rad]
    F_x, F_y, F_z   forces of an axle: along the wheel, across (``tyre``), load              [N]
    F, M  side force at the CG and yaw moment                                           [N, N m]
    s, y, Δψ  of the preview point, l_s ahead of the CG: exact for any angle, s is that of the
          nearest point of the path                                                 [m, m, rad]
    ρ     curvature of the path there [1/m]            h   height of the CG                  [m]

Drive and brakes give what the speed control asks for, as far as grip allows: an axle takes at most
``LONGITUDINAL_SHARE`` of μ F_z, as an anti-lock brake does. Brakes and rolling resistance are
friction: they stop the car, and hold it, and never drive it backwards.

The step is semi-implicit: forces by the state at its start, then speeds, then slips and place by
the new speeds. So it is stable where the tyre is stiff (fast) and where it is a spring (standing).
Sine and cosine are the project's own, so every processor gives the same bits.
"""

from typing import NamedTuple

from ...path.portable_trigonometry import cos_sin
from .tyre import TyreParams, damped_n, lateral_n, side_limit_n, slip_step

LONGITUDINAL_SHARE = 0.95
"""Chosen: what is left to the side is 0.31 of μ F_z."""
_LOAD_SHARE_MIN = 0.05
"""No axle lifts: each keeps this share of its load at rest."""
NEARNESS_MIN = 0.1
"""Of the path's radius: nearer to the centre of curvature the car has left the path."""


class CarParams(NamedTuple):
    """The symbols above, for one car.

    ``mass_1_kg``, ``yaw_inertia_1_kg_m2``  1/m and 1/J, because a division takes long
    ``load_shift_kg``                       m h/L
    ``drive_front``, ``brake_front``        shares
    """

    mass_kg: float
    mass_1_kg: float
    yaw_inertia_1_kg_m2: float
    front_axle_m: float
    rear_axle_m: float
    preview_m: float
    front_load_n: float
    rear_load_n: float
    load_shift_kg: float
    friction: float
    front: TyreParams
    rear: TyreParams
    drive_front: float
    brake_front: float
    drag_n_s2_m2: float
    rolling_m_s2: float


class CarState(NamedTuple):
    """u, v, r, α′ of both axles; accelerations by the forces; F_yf, its C α′/(3 D); s, y, Δψ."""

    speed_m_s: float
    lateral_speed_m_s: float
    yaw_rate_rad_s: float
    front_slip: float
    rear_slip: float
    longitudinal_m_s2: float
    lateral_m_s2: float
    front_lateral_n: float
    front_use: float
    arc_length_m: float
    lateral_error_m: float
    heading_error_rad: float


class CarInput(NamedTuple):
    """What acts during a step; ``friction`` is a factor on that of the tyres."""

    wheel_rad: float
    demand_m_s2: float
    side_force_n: float
    yaw_moment_n_m: float
    friction: float
    curvature_1_m: float


def car_step(p: CarParams, x: CarState, inputs: CarInput, h_s: float) -> CarState:
    """Return the state after ``h_s`` > 0."""
    u, v, r, front_slip, rear_slip, a_x, _, _, _, s, y, psi = x
    wheel_rad, demand_m_s2, side_force_n, yaw_moment_n_m, friction, rho = inputs
    mass, l_f, l_r = p.mass_kg, p.front_axle_m, p.rear_axle_m
    grip = p.friction * friction
    cos_wheel, sin_wheel = cos_sin(wheel_rad)

    front_load_n, rear_load_n = axle_loads_n(p, a_x)
    front_grip_n, rear_grip_n = grip * front_load_n, grip * rear_load_n

    drag_n = p.drag_n_s2_m2 * u * u
    wanted_n = mass * (demand_m_s2 + p.rolling_m_s2) + drag_n
    front_x_n, rear_x_n = along_n(p, wanted_n, front_grip_n, rear_grip_n)
    # Brakes that hold a standing car need not take their share.
    is_standing = u == 0.0 and wanted_n < 0.0
    front_limit_n = side_limit_n(front_grip_n, 0.0 if is_standing else front_x_n)
    rear_limit_n = side_limit_n(rear_grip_n, 0.0 if is_standing else rear_x_n)

    front_v = v + l_f * r
    front_along = abs(u * cos_wheel + front_v * sin_wheel)
    front_across = front_v * cos_wheel - u * sin_wheel
    rear_across = v - l_r * r
    front_use = p.front.stiffness_1_rad * front_load_n * front_slip / (3.0 * front_limit_n)
    front_y_n = lateral_n(p.front, front_load_n, front_limit_n, front_slip)
    front_y_n = damped_n(p.front, front_load_n, front_limit_n, front_y_n, front_along, front_across)
    rear_y_n = lateral_n(p.rear, rear_load_n, rear_limit_n, rear_slip)
    rear_y_n = damped_n(p.rear, rear_load_n, rear_limit_n, rear_y_n, u, rear_across)

    holding_n = mass * p.rolling_m_s2
    side_n = front_y_n * cos_wheel
    if wanted_n >= 0.0:
        pushing_n = front_x_n * cos_wheel + rear_x_n
        side_n += front_x_n * sin_wheel
    else:
        pushing_n = 0.0
        holding_n -= front_x_n * cos_wheel + rear_x_n
        if not is_standing:
            side_n += front_x_n * sin_wheel
    free_m_s = u + h_s * ((pushing_n - drag_n - front_y_n * sin_wheel) * p.mass_1_kg + v * r)
    stopped_m_s = h_s * holding_n * p.mass_1_kg
    u_after = free_m_s - stopped_m_s if free_m_s > stopped_m_s else 0.0
    a_x = (u_after - u) / h_s - v * r
    a_y = (side_n + rear_y_n + side_force_n) * p.mass_1_kg
    v += h_s * (a_y - u_after * r)
    r += h_s * (l_f * side_n - l_r * rear_y_n + yaw_moment_n_m) * p.yaw_inertia_1_kg_m2
    u = u_after

    front_v = v + l_f * r
    front_along = abs(u * cos_wheel + front_v * sin_wheel)
    front_across = front_v * cos_wheel - u * sin_wheel
    front_slip = slip_step(
        p.front, front_load_n, front_limit_n, front_slip, front_along, front_across, h_s
    )
    rear_slip = slip_step(p.rear, rear_load_n, rear_limit_n, rear_slip, u, v - l_r * r, h_s)

    # The heading midway makes the place exact to the second order of the step.
    cos_psi, sin_psi = cos_sin(psi + 0.5 * h_s * (r - rho * u))
    preview_v = v + p.preview_m * r
    s_rate = (u * cos_psi - preview_v * sin_psi) / max(1.0 - rho * y, NEARNESS_MIN)
    s += h_s * s_rate
    y += h_s * (u * sin_psi + preview_v * cos_psi)
    psi += h_s * (r - rho * s_rate)
    return CarState(u, v, r, front_slip, rear_slip, a_x, a_y, front_y_n, front_use, s, y, psi)


def axle_loads_n(p: CarParams, longitudinal_m_s2: float) -> tuple[float, float]:
    """Return the loads of both axles [N]."""
    shift_n = p.load_shift_kg * longitudinal_m_s2
    front_load_n = max(p.front_load_n - shift_n, _LOAD_SHARE_MIN * p.front_load_n)
    return front_load_n, max(p.rear_load_n + shift_n, _LOAD_SHARE_MIN * p.rear_load_n)


def along_n(
    p: CarParams, wanted_n: float, front_grip_n: float, rear_grip_n: float
) -> tuple[float, float]:
    """Return the longitudinal forces of both axles [N].

    ``wanted_n``  of drive and resistance that the speed control knows; a negative sum is the
                  brakes'
    """
    front_share = p.drive_front if wanted_n >= 0.0 else p.brake_front
    front_x_n = _within(front_share * wanted_n, LONGITUDINAL_SHARE * front_grip_n)
    return front_x_n, _within((1.0 - front_share) * wanted_n, LONGITUDINAL_SHARE * rear_grip_n)


def _within(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)
