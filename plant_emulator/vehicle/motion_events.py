"""Motion from event to event: actuator, path, disturbances around the exact propagation of (1).

Every change of the inputs is an event at a whole nanosecond: a command, the end of the wheel's
ramp, a break point of the path, a step of a disturbance. `advance_motion` goes from event to event
in closed form, so the result does not depend on how often it is called.

Time counts from the start of motion. The arc length s = V t is that of the point of the path at
the preview point, not at the centre of gravity. Only then is (1) exact: it has y at the preview
point, and Δψ and ρ without a preview distance. So ρ(s) both drives (1) and is the preview
curvature, and the centre of gravity starts `preview_distance_m` behind the path's start.
"""

import math
from typing import Final

from ...runtime.node import NEVER_NS, NS_PER_S
from ..path.path import Place, end_of_place_m, next_place
from .actuator import WheelSegment, at_rest, command_wheel, end_ramp
from .exact_propagation import LinearState, propagate
from .motion_parameters import MotionParams

Course = tuple[int, int, WheelSegment, Place, int, int, int]
"""The pieces of the inputs that apply now, and until when.

    first_row        where the transitions of this piece start in the table
    event_ns         the first of the three ends
    wheel            segment of the wheel, which has its end
    place            piece of the path
    place_end_ns     its end
    interval         of the disturbances
    interval_end_ns  its end
"""
_EVENT: Final = 1
_INTERVAL: Final = 5

MotionState = tuple[int, LinearState, Course]
"""Where the motion is [ns], its state there, and on which course."""


def event_ns_of(x: MotionState) -> int:
    """Return when the next event is due [ns]."""
    _, _, course = x
    return course[_EVENT]


def interval_of(x: MotionState) -> int:
    """Return which interval of the disturbances the motion is in."""
    _, _, course = x
    return course[_INTERVAL]


def start_motion(p: MotionParams) -> MotionState:
    """Return the state at time 0: where the settings say, not turning, wheel straight."""
    place, wheel = Place(0, 0), at_rest(0.0)
    rho, rho_rate = _curvature_along(p, place)
    first = p.intervals[0]
    w_beta, w_r = first.side_slip_disturbance_rad_s, first.yaw_disturbance_rad_s2
    psi, y = p.heading_error_rad, p.lateral_error_m
    linear = (0.0, 0.0, psi, y, 0.0, 0.0, rho, rho_rate, w_beta, w_r)
    course = _course(p, wheel, place, _place_end_ns(p, place), 0, _interval_end_ns(p, 0))
    return 0, linear, course


def command_motion(p: MotionParams, x: MotionState, steer_rad: float) -> MotionState:
    """Return the state after a steering command has reached the actuator."""
    time_ns, (beta, r, psi, y, wheel_rad, _, rho, rho_rate, w_beta, w_r), course = x
    wheel = command_wheel(p.actuator, wheel_rad, steer_rad, time_ns)
    wheel_rad, wheel_rate_rad_s, _, _, _, _ = wheel
    linear = (beta, r, psi, y, wheel_rad, wheel_rate_rad_s, rho, rho_rate, w_beta, w_r)
    _, _, _, place, place_end_ns, interval, interval_end_ns = course
    course = _course(p, wheel, place, place_end_ns, interval, interval_end_ns)
    return time_ns, linear, course


def advance_motion(p: MotionParams, x: MotionState, to_ns: int) -> MotionState:
    """Return the state at ``to_ns`` >= its time, with all events up to and at that time."""
    time_ns, linear, course = x
    while course[_EVENT] <= to_ns:
        x = _pass_event(p, x)
        time_ns, linear, course = x
    if time_ns == to_ns:
        return x
    first_row, _, _, _, _, _, _ = course
    return to_ns, propagate(p.table, first_row, linear, to_ns - time_ns), course


def disturb_motion(p: MotionParams, x: MotionState) -> MotionState:
    """Return the state with the first interval of ``p`` begun; all else in it is as before."""
    time_ns, z, course = x
    first = p.intervals[0]
    w_beta, w_r = first.side_slip_disturbance_rad_s, first.yaw_disturbance_rad_s2
    beta, r, psi, y, delta, delta_rate, rho, rho_rate, _, _ = z
    linear = (beta, r, psi, y, delta, delta_rate, rho, rho_rate, w_beta, w_r)
    _, _, wheel, place, place_end_ns, _, _ = course
    course = _course(p, wheel, place, place_end_ns, 0, _interval_end_ns(p, 0))
    return time_ns, linear, course


def _pass_event(p: MotionParams, x: MotionState) -> MotionState:
    """Return the state at the next event, after what it changes."""
    time_ns, z, course = x
    first_row, event_ns, wheel, place, place_end_ns, interval, interval_end_ns = course
    z = propagate(p.table, first_row, z, event_ns - time_ns)
    beta, r, psi, y, delta, delta_rate, rho, rho_rate, w_beta, w_r = z
    _, _, _, goal_rad, clipped, wheel_end_ns = wheel
    if wheel_end_ns == event_ns:
        wheel = end_ramp(p.actuator, delta, goal_rad, clipped)
        delta, delta_rate, _, _, _, _ = wheel
    if place_end_ns == event_ns:
        place = next_place(p.path, place)
        place_end_ns = _place_end_ns(p, place)
        rho, rho_rate = _curvature_along(p, place)
    if interval_end_ns == event_ns:
        interval += 1
        interval_end_ns = _interval_end_ns(p, interval)
        w_beta = p.intervals[interval].side_slip_disturbance_rad_s
        w_r = p.intervals[interval].yaw_disturbance_rad_s2
    z = (beta, r, psi, y, delta, delta_rate, rho, rho_rate, w_beta, w_r)
    course = _course(p, wheel, place, place_end_ns, interval, interval_end_ns)
    return event_ns, z, course


def _course(
    p: MotionParams,
    wheel: WheelSegment,
    place: Place,
    place_end_ns: int,
    interval: int,
    interval_end_ns: int,
) -> Course:
    _, _, phase, _, _, event_ns = wheel
    first_row = p.first_rows[interval][phase]
    if place_end_ns < event_ns:
        event_ns = place_end_ns
    if interval_end_ns < event_ns:
        event_ns = interval_end_ns
    return first_row, event_ns, wheel, place, place_end_ns, interval, interval_end_ns


def _curvature_along(p: MotionParams, place: Place) -> tuple[float, float]:
    """Return the curvature at the start of a piece of the path [1/m], and its rate [1/(m s)]."""
    return p.path.curvature_1_m[place.piece], (
        p.path.curvature_slope_1_m2[place.piece] * p.speed_m_s
    )


def _place_end_ns(p: MotionParams, place: Place) -> int:
    end_s = end_of_place_m(p.path, place) / p.speed_m_s
    return NEVER_NS if end_s == math.inf else round(end_s * NS_PER_S)


def _interval_end_ns(p: MotionParams, interval: int) -> int:
    later = interval + 1
    return p.intervals[later].start_ns if later < len(p.intervals) else NEVER_NS


def with_vehicle(
    x: MotionState,
    side_slip_rad: float,
    yaw_rate_rad_s: float,
    heading_rad: float,
    lateral_m: float,
) -> MotionState:
    """Return the state with the vehicle's part replaced; wheel, path and disturbances stay."""
    time_ns, z, course = x
    _, _, _, _, delta, delta_rate, rho, rho_rate, w_beta, w_r = z
    vehicle = (side_slip_rad, yaw_rate_rad_s, heading_rad, lateral_m)
    return time_ns, (*vehicle, delta, delta_rate, rho, rho_rate, w_beta, w_r), course
