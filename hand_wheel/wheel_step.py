"""Motion of the hand wheel in the driver's hands: inertia, friction that sticks, stops, motor.

    (J + J_a) ω' = u + T_d - k_a (θ - θ_w) - (b + b_a) ω + b_a θ_w' - F_c sgn ω       θ' = ω
    u' = (u_cmd - u)/T_m,   |u_cmd| ≤ u_max

    θ, ω      angle and rate of the wheel, to the left positive            [rad], [rad/s]
    u, u_cmd  torque of the motor, and what it is told                     [N m]
    T_d       torque of the driver besides his arms' impedance             [N m]
    θ_w       angle that the driver wishes
    J_a, b_a, k_a   his arms (``Grip``)          F_c   Coulomb friction    [N m]

A step is trapezoidal, with the mean of the motor's exact torque; so a linear wheel (F_c = 0) moves
as the exact one up to an error of the third order in the step. Above a torque sensor that gives way
the rim is a second mass (``wheel``), whose mean rate follows from that of the wheel. Friction acts
below it, by the rate at the step's end: where it can stop the wheel within the step, the rate there
is zero, and a wheel at rest stays exactly where it is.
"""

from math import exp
from typing import NamedTuple

from .wheel import Grip, WheelSettings


class WheelParams(NamedTuple):
    """The symbols above, without the arms.

    ``kept``        share of the motor's lack that is left after a step, e^(-h/T_m)
    ``kept_mean``   its mean over the step
    ``step_s``      h
    ``sensor_n_m_rad``  stiffness of the torque sensor, 0: rigid; ``rim_kg_m2`` is above it
    """

    inertia_kg_m2: float
    damping_n_m_s: float
    friction_n_m: float
    stop_rad: float
    torque_n_m_max: float
    kept: float
    kept_mean: float
    step_s: float
    sensor_n_m_rad: float
    rim_kg_m2: float


class WheelState(NamedTuple):
    """The wheel; ``driver_torque_n_m`` is by the torque sensor, which the rim is above."""

    angle_rad: float
    rate_rad_s: float
    motor_n_m: float
    driver_torque_n_m: float
    rim_rad: float = 0.0
    rim_rad_s: float = 0.0


class Hands(NamedTuple):
    """What the driver does during a step."""

    grip: Grip
    wished_rad: float
    wished_rad_s: float
    torque_n_m: float


AT_REST = WheelState(0.0, 0.0, 0.0, 0.0)


def wheel_params(wheel: WheelSettings, step_s: float) -> WheelParams:
    """Return the constants of steps of ``step_s`` > 0."""
    steps = step_s / wheel.motor_lag_s
    kept = exp(-steps)
    rim_kg_m2 = wheel.rim_share * wheel.inertia_kg_m2 if wheel.sensor_n_m_rad else 0.0
    return WheelParams(
        wheel.inertia_kg_m2 - rim_kg_m2, wheel.damping_n_m_s, wheel.friction_n_m, wheel.stop_rad,
        wheel.torque_n_m_max, kept, (1.0 - kept) / steps, step_s, wheel.sensor_n_m_rad, rim_kg_m2,
    )  # fmt: skip


def wheel_step(p: WheelParams, x: WheelState, command_n_m: float, hands: Hands) -> WheelState:
    """Return the state after a step, with the command held."""
    angle, rate, motor_n_m, _, rim, rim_rate = x
    (arms_inertia, arms_damping, stiffness), wished, wished_rate, torque_n_m = hands
    h, sensor = p.step_s, p.sensor_n_m_rad
    lack_n_m = motor_n_m - min(max(command_n_m, -p.torque_n_m_max), p.torque_n_m_max)
    told_n_m = motor_n_m - lack_n_m
    above = p.rim_kg_m2 + arms_inertia
    # Mean rate over the step, as if without friction: resistance times it is what pushes.
    pushes = told_n_m + p.kept_mean * lack_n_m
    link = held = by_rim = 0.0
    if sensor == 0.0:
        inertia = p.inertia_kg_m2 + above
        resistance = 2.0 * inertia / h + p.damping_n_m_s + arms_damping + 0.5 * h * stiffness
        pushes = pushes + torque_n_m + arms_damping * wished_rate
        pushes += stiffness * (wished + 0.5 * h * wished_rate - angle) + 2.0 * inertia / h * rate
    else:
        link, twist_n_m = 0.5 * h * sensor, sensor * (rim - angle)
        held = 2.0 * above / h + arms_damping + 0.5 * h * stiffness + link
        by_rim = torque_n_m + arms_damping * wished_rate - twist_n_m + 2.0 * above / h * rim_rate
        by_rim += stiffness * (wished + 0.5 * h * wished_rate - rim)
        resistance = 2.0 * p.inertia_kg_m2 / h + p.damping_n_m_s + link - link * link / held
        pushes += twist_n_m + 2.0 * p.inertia_kg_m2 / h * rate + link * by_rim / held
    free_rate = 2.0 * pushes / resistance - rate
    stopped_rate = 2.0 * p.friction_n_m / resistance
    if free_rate > stopped_rate:
        end_rate = free_rate - stopped_rate
    elif free_rate < -stopped_rate:
        end_rate = free_rate + stopped_rate
    else:
        end_rate = 0.0
    mean_rate = 0.5 * (rate + end_rate)
    end_angle = angle + h * mean_rate
    acceleration = (end_rate - rate) / h
    if abs(end_angle) >= p.stop_rad:
        end_angle = p.stop_rad if end_angle > 0.0 else -p.stop_rad
        if end_angle * end_rate > 0.0:
            end_rate = acceleration = 0.0
    motor_n_m = told_n_m + p.kept * lack_n_m
    if sensor != 0.0:
        mean_rate = (by_rim + link * (end_angle - angle) / h) / held
        rim, rim_rate = rim + h * mean_rate, 2.0 * mean_rate - rim_rate
        return WheelState(end_angle, end_rate, motor_n_m, sensor * (rim - end_angle), rim, rim_rate)
    mean_angle = angle + 0.5 * h * mean_rate
    hands_n_m = torque_n_m + arms_damping * (wished_rate - mean_rate)
    hands_n_m += stiffness * (wished + 0.5 * h * wished_rate - mean_angle)
    hands_n_m -= arms_inertia * acceleration
    return WheelState(end_angle, end_rate, motor_n_m, hands_n_m, end_angle, end_rate)
