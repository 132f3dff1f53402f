"""The steering of a car: which equations move its front wheels, by the type of their params.

A steering is a step ``(params, state, input, h) -> state``; its state begins with the angle of the
wheel and its rate, and whether a limit shapes the motion. The moment of the road acts one step
late: it is that of the tyre's force at the start of the step.
"""

from collections.abc import Callable
from typing import Any, NamedTuple


class SteeringInput(NamedTuple):
    """The command, and what the road does: lateral force of the front axle, its slip and speed."""

    command_rad: float
    front_lateral_n: float
    front_slip: float
    speed_m_s: float


class FirstOrderParams(NamedTuple):
    """`[actuator]`; infinite for a limit that does not exist."""

    lag_s: float
    angle_limit_rad: float
    rate_limit_rad_s: float
    dead_band_rad: float


class FirstOrderState(NamedTuple):
    """The wheel."""

    wheel_rad: float
    wheel_rate_rad_s: float
    is_limited: bool


def first_order_step(
    p: FirstOrderParams, x: FirstOrderState, inputs: SteeringInput, h_s: float
) -> FirstOrderState:
    """Return the wheel of ``vehicle.actuator`` after ``h_s``, by the trapezoidal rule."""
    before_rad, _, _ = x
    target_rad = min(max(inputs.command_rad, -p.angle_limit_rad), p.angle_limit_rad)
    is_limited = target_rad != inputs.command_rad
    low_rad, high_rad = target_rad - p.dead_band_rad, target_rad + p.dead_band_rad
    goal_rad = min(max(before_rad, low_rad), high_rad)
    move_rad = min(h_s / (p.lag_s + 0.5 * h_s), 1.0) * (goal_rad - before_rad)
    most_rad = p.rate_limit_rad_s * h_s
    if abs(move_rad) > most_rad:
        is_limited = True
        move_rad = most_rad if move_rad > 0.0 else -most_rad
    return FirstOrderState(before_rad + move_rad, move_rad / h_s, is_limited)


STEERINGS: dict[type, tuple[Callable[..., Any], Any]] = {
    FirstOrderParams: (first_order_step, FirstOrderState(0.0, 0.0, False)),
}
"""By the type of the params: the step, and the state at rest."""


def steering_step(p: Any, x: Any, inputs: SteeringInput, h_s: float) -> Any:
    """Return the state of the steering after ``h_s``."""
    step, _ = STEERINGS[type(p)]
    return step(p, x, inputs, h_s)


def steering_at_rest(p: Any) -> Any:
    """Return the state of the steering at the start."""
    _, at_rest = STEERINGS[type(p)]
    return at_rest
