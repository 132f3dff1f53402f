"""The simple steering of a car: a wheel that follows its target with a lag, and a rate limit."""

from typing import NamedTuple

from .steering_input import SteeringInput

_NOTHING_RAD = 1e-30
"""A wheel so near its goal is there: further halvings end at numbers that take a processor long."""


class FirstOrderParams(NamedTuple):
    """`[actuator]`; infinite for a limit that does not exist."""

    lag_s: float
    angle_limit_rad: float
    rate_limit_rad_s: float
    dead_band_rad: float


class FirstOrderState(NamedTuple):
    """As of every steering."""

    wheel_rad: float
    wheel_rate_rad_s: float
    is_limited: bool
    road_rad: float


FIRST_ORDER_AT_REST = FirstOrderState(0.0, 0.0, False, 0.0)


def first_order_step(
    p: FirstOrderParams, x: FirstOrderState, inputs: SteeringInput, h_s: float
) -> FirstOrderState:
    """Return the wheel of ``vehicle.actuator`` after ``h_s``, by the trapezoidal rule."""
    _, _, _, road_rad = x
    before_rad = road_rad + inputs.sensor_rad
    target_rad = min(max(inputs.command_rad, -p.angle_limit_rad), p.angle_limit_rad)
    is_limited = target_rad != inputs.command_rad
    low_rad, high_rad = target_rad - p.dead_band_rad, target_rad + p.dead_band_rad
    goal_rad = min(max(before_rad, low_rad), high_rad)
    left_rad = goal_rad - before_rad
    share = min(h_s / (p.lag_s + 0.5 * h_s), 1.0) if abs(left_rad) > _NOTHING_RAD else 1.0
    move_rad = share * left_rad
    move_rad *= inputs.rate_share
    most_rad = p.rate_limit_rad_s * inputs.rate_share * h_s if inputs.rate_share else 0.0
    if abs(move_rad) > most_rad:
        is_limited = True
        move_rad = most_rad if move_rad > 0.0 else -most_rad
    return FirstOrderState(before_rad + move_rad, move_rad / h_s, is_limited, road_rad + move_rad)
