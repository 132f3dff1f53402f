"""The motion of the plant: linear and exact, or that of a car; the type of its params decides.

Compiled loops make the same choice when they are compiled.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

from ...runtime.node import NS_PER_S
from .actuator import is_limited
from .car.car_motion import (
    CarMotionParams,
    advance_car,
    brake_car,
    command_car,
    disturb_car,
    interval_end_ns_of,
    is_car_limited,
    limit_car,
    place_of_car,
    rack_force_of_car_n,
    start_car,
)
from .motion_events import (
    advance_motion,
    command_motion,
    disturb_motion,
    event_ns_of,
    interval_of,
    start_motion,
)
from .motion_parameters import MotionParams
from .single_track_model import VehicleParams, front_slip_rad


class MotionSteps(NamedTuple):
    """The functions of one kind of motion; a state is time [ns], what sensors read, and the rest.

    ``start(params)``                  returns the state at time 0
    ``command(params, state, steer)``  that after a command [rad]
    ``disturb(params, state)``         that after other disturbances, the first interval of params
    ``advance(params, state, to_ns)``  that at a later time
    ``limit(state, speed)``            that after a request not to exceed a speed [m/s]
    ``brake(state, brake)``            that after a request to brake to a stop [m/s²], 0: no more
    ``place(params, state)``           arc length beside the preview point [m], and speed [m/s]
    ``event_ns(state)``                when the inputs change next, for the interval of params
    ``is_limited(state)``              whether a limit of the actuator shapes the wheel's motion
    ``rack_force_n(params, state, vehicle, trail, arm)``  force of the tyres on the rack, left
                                       positive [N]; by trail and arm [m] where there is no rack
    """

    start: Callable[..., Any]
    command: Callable[..., Any]
    disturb: Callable[..., Any]
    advance: Callable[..., Any]
    limit: Callable[..., Any]
    brake: Callable[..., Any]
    place: Callable[..., Any]
    event_ns: Callable[..., Any]
    is_limited: Callable[..., Any]
    rack_force_n: Callable[..., Any]


def place_of_linear(p: MotionParams, x: Any) -> tuple[float, float]:
    """Return the arc length beside the preview point [m], and the speed [m/s]."""
    (time_ns, _, _), speed_m_s = x, p.speed_m_s
    return speed_m_s * (time_ns / NS_PER_S), speed_m_s


def _at_constant_speed(x: Any, _: float) -> Any:
    return x


def _is_linear_limited(x: Any) -> bool:
    _, _, (_, _, wheel, _, _, _, _) = x
    return is_limited(wheel)


def _rack_force_of_linear_n(
    p: MotionParams, x: Any, vehicle: VehicleParams, trail_m: float, arm_m: float
) -> float:
    """Return the force by the vehicle's cornering stiffness, at the present friction."""
    _, (beta, r, _, _, wheel_rad, _, _, _, _, _), _ = x
    now = p.intervals[interval_of(x)]
    slip_rad = front_slip_rad(vehicle, wheel_rad + now.steering_offset_rad, beta, r)
    front_n = now.friction * vehicle.front_cornering_stiffness_n_rad * slip_rad
    # Caster and tyre turn the wheels out of the turn, so the rack is pushed to the other side.
    return -front_n * trail_m / arm_m


MOTIONS: dict[type, MotionSteps] = {
    MotionParams: MotionSteps(
        start_motion,
        command_motion,
        disturb_motion,
        advance_motion,
        _at_constant_speed,
        _at_constant_speed,
        place_of_linear,
        event_ns_of,
        _is_linear_limited,
        _rack_force_of_linear_n,
    ),
    CarMotionParams: MotionSteps(
        start_car,
        command_car,
        disturb_car,
        advance_car,
        limit_car,
        brake_car,
        place_of_car,
        interval_end_ns_of,
        is_car_limited,
        rack_force_of_car_n,
    ),
}
"""By the type of the params."""
