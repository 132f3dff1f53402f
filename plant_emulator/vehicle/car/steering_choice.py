"""The steering of a car: which equations move its front wheels, by the type of their params.

A steering is a step ``(params, state, input, h) -> state``. Its state begins with the angle that
its sensor reads and its rate, whether a limit shapes the motion, and the angle of the wheels on the
road. The moment of the road acts one step late: it is that of the tyre's force at the start of the
step.
"""

from collections.abc import Callable
from typing import Any

from .first_order import FIRST_ORDER_AT_REST, FirstOrderParams, first_order_step
from .rack import RACK_AT_REST, RackParams, rack_step
from .steering_input import SteeringInput

STEERINGS: dict[type, tuple[Callable[..., Any], Any]] = {
    FirstOrderParams: (first_order_step, FIRST_ORDER_AT_REST),
    RackParams: (rack_step, RACK_AT_REST),
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


def rack_force_n(p: Any, x: Any, by_axle_n: float) -> float:
    """Return the force of the tyres on the rack; ``by_axle_n`` for a steering without a rack."""
    return float(x.rack_force_n) if type(p) is RackParams else by_axle_n
