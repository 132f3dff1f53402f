"""The motion of a car from event to event, in steps on a fixed grid.

A step ends at the next whole millisecond of motion, at a command or at a change of the disturbance,
whichever comes first. A state between two of these is a step that is not kept, so the motion does
not depend on how often it is read.
"""

from collections.abc import Sequence
from math import inf, pi
from typing import Any, NamedTuple

from ....runtime.node import NEVER_NS
from ...path.path import Path, Place, end_of_place_m, next_place
from ...path.portable_trigonometry import arctan
from ..exact_propagation import LinearState
from .axle_use import AxleUse, axle_use
from .car_choice import drive_step, start_of_own
from .car_step import NEARNESS_MIN, CarInput, CarParams, CarState
from .speed_control import SpeedParams, demand_step, wanted_speed
from .steering_choice import rack_force_n, steering_at_rest, steering_step
from .steering_input import SteeringInput

STEP_NS = 1_000_000
HEADING_RAD_MAX = pi / 3.0
"""A larger heading error: the car has left the path."""


class CarInterval(NamedTuple):
    """What acts on the car from ``start_ns`` until the next interval; the rest as `SteeringInput`.

    ``command_factor``  on the command
    ``sensor_rad_s``    by which ``sensor_rad`` grows
    """

    start_ns: int
    side_force_n: float
    yaw_moment_n_m: float
    steering_offset_rad: float
    friction: float
    torque_share: float = 1.0
    resistance_factor: float = 1.0
    rate_share: float = 1.0
    command_factor: float = 1.0
    sensor_rad: float = 0.0
    sensor_rad_s: float = 0.0


class GripPatch(NamedTuple):
    """A part of the road: the CG's arc length where it ends, and a factor on the friction."""

    end_m: float
    friction: float


class CarMotionParams(NamedTuple):
    """Constants of a motion; ``car`` and ``steering`` as their modules choose."""

    car: Any
    steering: Any
    speed: SpeedParams
    path: Path
    patches: Sequence[GripPatch]
    intervals: Sequence[CarInterval]
    speed_m_s: float
    """At the start."""
    preview_distance_m: float
    lateral_error_m: float
    """Of the preview point at the start, as the next."""
    heading_error_rad: float
    dead_time_ns: int


class CarMoment(NamedTuple):
    """The state at one time.

    ``own``          state of the car's own (``car_choice``)
    ``demand_m_s2``  of the speed control
    ``leg``          of its profile
    ``place``        piece of the path beside the preview point
    ``patch``        of the road
    """

    car: CarState
    own: Any
    steering: Any
    demand_m_s2: float
    leg: int
    place: Place
    patch: int


Orders = tuple[float, float, float]
"""The steering command [rad], the speed that somebody on the bus asks not to exceed [m/s], and the
braking to a stop, 0 for none [m/s²]."""

CarCourse = tuple[int, CarMoment, CarMoment, Orders, int, int]
"""Time [ns] and state of the last step that is kept, the state now, the orders, the interval of the
disturbances and its end [ns]."""

Tyres = tuple[float, float, float, float, float]
"""Slips of front and rear, longitudinal acceleration and demand for it [m/s²], friction factor."""

CarMotionState = tuple[int, LinearState, CarCourse]
"""As ``motion_events.MotionState``: time [ns], what sensors read, and the rest.

In what sensors read, the last three are 0; the lateral error is infinite once the path is left.
"""


def start_car(p: CarMotionParams) -> CarMotionState:
    """Return the state at time 0."""
    lateral_m, heading_rad = p.lateral_error_m, p.heading_error_rad
    car = CarState(p.speed_m_s, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, lateral_m, heading_rad)
    now = CarMoment(car, start_of_own(p.car), steering_at_rest(p.steering), 0.0, 0, Place(0, 0), 0)
    return 0, _shown(p, now), (0, now, now, (0.0, inf, 0.0), 0, _interval_end_ns(p, 0))


def command_car(p: CarMotionParams, x: CarMotionState, steer_rad: float) -> CarMotionState:  # noqa: ARG001 - as the linear motion
    """Return the state after a steering command has reached the actuator."""
    time_ns, shown, (_, _, now, (_, limit_m_s, brake_m_s2), interval, interval_end_ns) = x
    orders = steer_rad, limit_m_s, brake_m_s2
    return time_ns, shown, (time_ns, now, now, orders, interval, interval_end_ns)


def limit_car(x: CarMotionState, limit_m_s: float) -> CarMotionState:
    """Return the state after somebody has asked not to exceed a speed."""
    time_ns, shown, (_, _, now, (steer_rad, _, brake_m_s2), interval, interval_end_ns) = x
    orders = steer_rad, limit_m_s, brake_m_s2
    return time_ns, shown, (time_ns, now, now, orders, interval, interval_end_ns)


def brake_car(x: CarMotionState, brake_m_s2: float) -> CarMotionState:
    """Return the state after a request to brake to a stop, or no more (0)."""
    time_ns, shown, (_, _, now, (steer_rad, limit_m_s, _), interval, interval_end_ns) = x
    orders = steer_rad, limit_m_s, brake_m_s2
    return time_ns, shown, (time_ns, now, now, orders, interval, interval_end_ns)


def disturb_car(p: CarMotionParams, x: CarMotionState) -> CarMotionState:
    """Return the state in the interval of ``p`` that its time is in."""
    time_ns, shown, (_, _, now, orders, _, _) = x
    interval = 0
    while _interval_end_ns(p, interval) <= time_ns:
        interval += 1
    return time_ns, shown, (time_ns, now, now, orders, interval, _interval_end_ns(p, interval))


def advance_car(p: CarMotionParams, x: CarMotionState, to_ns: int) -> CarMotionState:
    """Return the state at ``to_ns`` >= its time."""
    time_ns, _, (kept_ns, kept, now, orders, interval, interval_end_ns) = x
    if time_ns == to_ns and interval_end_ns > to_ns:
        return x
    while True:
        end_ns = (kept_ns // STEP_NS + 1) * STEP_NS
        if interval_end_ns < end_ns:
            end_ns = interval_end_ns
        is_kept = end_ns <= to_ns
        if not is_kept:
            end_ns = to_ns
        now = kept
        if end_ns > kept_ns:
            now = _moment_step(p, kept, orders, interval, kept_ns, end_ns)
        if not is_kept:
            break
        kept_ns, kept = end_ns, now
        if interval_end_ns == end_ns:
            interval += 1
            interval_end_ns = _interval_end_ns(p, interval)
        if kept_ns == to_ns:
            break
    return to_ns, _shown(p, now), (kept_ns, kept, now, orders, interval, interval_end_ns)


def place_of_car(p: CarMotionParams, x: CarMotionState) -> tuple[float, float]:  # noqa: ARG001
    """Return the arc length beside the preview point [m], and the speed [m/s]."""
    _, _, (_, _, now, _, _, _) = x
    return now.car.arc_length_m, now.car.speed_m_s


def _moment_step(
    p: CarMotionParams, x: CarMoment, orders: Orders, interval: int, from_ns: int, to_ns: int
) -> CarMoment:
    """Return the state after one step of steering, speed control and car."""
    car, own, steering, demand_m_s2, leg, place, patch = x
    command_rad, limit_m_s, brake_m_s2 = orders
    h_s = 1e-9 * (to_ns - from_ns)
    load = p.intervals[interval]
    acts = SteeringInput(
        command_rad * load.command_factor,
        car.front_lateral_n,
        car.front_use,
        load.torque_share,
        load.resistance_factor,
        load.rate_share,
        load.sensor_rad + load.sensor_rad_s * (1e-9 * (to_ns - load.start_ns)),
    )
    steering = steering_step(p.steering, steering, acts, h_s)
    cg_m = car.arc_length_m - p.preview_distance_m
    while cg_m >= p.patches[patch].end_m:
        patch += 1
    at = cg_m if p.speed.over_arc_length else 1e-9 * to_ns
    leg, wanted_m_s, rate_m_s2 = wanted_speed(p.speed, leg, at)
    if wanted_m_s > limit_m_s:
        wanted_m_s, rate_m_s2 = limit_m_s, 0.0
    if brake_m_s2 > 0.0:
        wanted_m_s, rate_m_s2 = 0.0, 0.0
    demand_m_s2 = demand_step(p.speed, demand_m_s2, wanted_m_s, rate_m_s2, car.speed_m_s, h_s)
    if brake_m_s2 > 0.0:
        demand_m_s2 = max(demand_m_s2, -brake_m_s2)
    inputs = CarInput(
        steering.road_rad + load.steering_offset_rad,
        demand_m_s2,
        load.side_force_n,
        load.yaw_moment_n_m,
        load.friction * p.patches[patch].friction,
        _curvature_1_m(p.path, place, car.arc_length_m),
    )
    car, own = drive_step(p.car, car, own, inputs, h_s)
    while car.arc_length_m >= end_of_place_m(p.path, place):
        place = next_place(p.path, place)
    return CarMoment(car, own, steering, demand_m_s2, leg, place, patch)


def _curvature_1_m(path: Path, place: Place, arc_length_m: float) -> float:
    along_m = arc_length_m - (place.lap * path.length_m + path.start_m[place.piece])
    return path.curvature_1_m[place.piece] + path.curvature_slope_1_m2[place.piece] * along_m


def _shown(p: CarMotionParams, x: CarMoment) -> LinearState:
    """Return what sensors read."""
    car, wheel = x.car, x.steering
    u, lateral_m, heading_rad = car.speed_m_s, car.lateral_error_m, car.heading_error_rad
    rho = _curvature_1_m(p.path, x.place, car.arc_length_m)
    if abs(heading_rad) > HEADING_RAD_MAX or 1.0 - rho * lateral_m < NEARNESS_MIN:
        lateral_m = inf
    side_slip_rad = arctan(car.lateral_speed_m_s / u) if u > 0.0 else 0.0
    vehicle = side_slip_rad, car.yaw_rate_rad_s, heading_rad, lateral_m
    return (*vehicle, wheel.wheel_rad, wheel.wheel_rate_rad_s, rho, 0.0, 0.0, 0.0)


def interval_end_ns_of(x: CarMotionState) -> int:
    """Return when the next interval of the disturbances begins [ns]."""
    _, _, (_, _, _, _, _, interval_end_ns) = x
    return interval_end_ns


def rack_force_of_car_n(
    p: CarMotionParams, x: CarMotionState, _vehicle: Any, trail_m: float, arm_m: float
) -> float:
    """Return the force of the tyres on the rack, to the left positive [N]."""
    _, _, (_, _, now, _, _, _) = x
    return rack_force_n(p.steering, now.steering, -now.car.front_lateral_n * trail_m / arm_m)


def tyres_of_car(p: CarMotionParams, x: CarMotionState) -> Tyres:
    """Return what ``axle_use_of`` needs besides the speed."""
    _, _, (_, _, now, _, interval, _) = x
    car = now.car
    friction = p.intervals[interval].friction * p.patches[now.patch].friction
    return car.front_slip, car.rear_slip, car.longitudinal_m_s2, now.demand_m_s2, friction


def axle_use_of_car(p: CarMotionParams, x: CarMotionState) -> AxleUse | None:
    """Return what the axles bear and give; None for a car of another package."""
    _, _, (_, _, now, _, _, _) = x
    if not isinstance(p.car, CarParams):
        return None
    *_, demand_m_s2, friction = tyres_of_car(p, x)
    return axle_use(p.car, now.car, demand_m_s2, friction)


def is_car_limited(x: CarMotionState) -> bool:
    """Return whether a limit of the actuator shapes the wheel's motion now."""
    _, _, (_, _, now, _, _, _) = x
    return bool(now.steering.is_limited)


def _interval_end_ns(p: CarMotionParams, interval: int) -> int:
    """Return when an interval of the disturbances ends."""
    later = interval + 1
    return p.intervals[later].start_ns if later < len(p.intervals) else NEVER_NS
