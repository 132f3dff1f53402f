"""The moving vehicle: actuator, path and disturbances around the exact propagation of (1).

Every change of the inputs is an event at a whole nanosecond: a command, the end of the wheel's
ramp, a break point of the path, a step of a disturbance. `advance` goes from event to event in
closed form, so the result does not depend on how often it is called.

Time counts from the start of motion. The arc length s = V t is that of the point of the path beside
the preview point, not beside the centre of gravity. Only then is (1) exact, which measures y at the
preview point, and Δψ and ρ without a preview distance. So ρ(s) both drives (1) and is the preview
curvature, and the centre of gravity starts `preview_distance_m` behind the path's start.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

from ..runtime.node import NEVER_NS, NS_PER_S
from .actuator import WheelSegment, at_rest, command_wheel, end_ramp, is_limited
from .motion_design import MotionParams
from .path import Path, Place, Pose, end_of_place_m, next_place, vehicle_pose
from .propagation import LinearState, propagate

LARGEST = 1e150
"""Magnitude beyond which a state counts as infinite, because figures of a run take its square."""


class MotionState(NamedTuple):
    """State of the motion, and the pieces of path and disturbance that it is in."""

    time_ns: int
    linear: LinearState
    wheel: WheelSegment
    place: Place
    place_end_ns: int
    interval: int
    interval_end_ns: int


def start_motion(p: MotionParams) -> MotionState:
    """Return the state at time 0: on the path, along it, wheel straight."""
    linear = LinearState(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    x = MotionState(0, linear, at_rest(0.0), Place(0, 0), 0, -1, 0)
    return _enter_interval(p, _enter_place(p, x, Place(0, 0)), 0)


def command_motion(p: MotionParams, x: MotionState, steer_rad: float) -> MotionState:
    """Return the state after a steering command has reached the actuator."""
    return _move_wheel(x, command_wheel(p.actuator, x.linear.wheel_rad, steer_rad, x.time_ns))


def advance_motion(p: MotionParams, x: MotionState, to_ns: int) -> MotionState:
    """Return the state at ``to_ns`` >= its time, with all events up to and at that time."""
    while True:
        event_ns = min(x.wheel.end_ns, x.place_end_ns, x.interval_end_ns)
        if event_ns > to_ns:
            return _coast(p, x, to_ns)
        x = _coast(p, x, event_ns)
        if x.wheel.end_ns == event_ns:
            x = _move_wheel(x, end_ramp(p.actuator, x.wheel, x.linear.wheel_rad))
        if x.place_end_ns == event_ns:
            x = _enter_place(p, x, next_place(p.path, x.place))
        if x.interval_end_ns == event_ns:
            x = _enter_interval(p, x, x.interval + 1)


def _coast(p: MotionParams, x: MotionState, to_ns: int) -> MotionState:
    """Return the state at ``to_ns``, before which there is no event."""
    first_row = p.first_rows[x.interval][x.wheel.phase]
    linear = propagate(p.table, first_row, x.linear, to_ns - x.time_ns)
    return MotionState(
        to_ns, linear, x.wheel, x.place, x.place_end_ns, x.interval, x.interval_end_ns
    )


def _move_wheel(x: MotionState, wheel: WheelSegment) -> MotionState:
    z = x.linear
    linear = LinearState(
        z.side_slip_rad,
        z.yaw_rate_rad_s,
        z.heading_error_rad,
        z.lateral_error_m,
        wheel.wheel_rad,
        wheel.wheel_rate_rad_s,
        z.curvature_1_m,
        z.curvature_rate_1_m_s,
        z.side_slip_disturbance_rad_s,
        z.yaw_disturbance_rad_s2,
    )
    return MotionState(
        x.time_ns, linear, wheel, x.place, x.place_end_ns, x.interval, x.interval_end_ns
    )


def _enter_place(p: MotionParams, x: MotionState, place: Place) -> MotionState:
    """Return the state at the start of a piece of the path."""
    z = x.linear
    linear = LinearState(
        z.side_slip_rad,
        z.yaw_rate_rad_s,
        z.heading_error_rad,
        z.lateral_error_m,
        z.wheel_rad,
        z.wheel_rate_rad_s,
        p.path.curvature_1_m[place.piece],
        p.path.curvature_slope_1_m2[place.piece] * p.speed_m_s,
        z.side_slip_disturbance_rad_s,
        z.yaw_disturbance_rad_s2,
    )
    end_s = end_of_place_m(p.path, place) / p.speed_m_s
    end_ns = NEVER_NS if end_s == math.inf else round(end_s * NS_PER_S)
    return MotionState(x.time_ns, linear, x.wheel, place, end_ns, x.interval, x.interval_end_ns)


def _enter_interval(p: MotionParams, x: MotionState, interval: int) -> MotionState:
    """Return the state at the start of an interval of the disturbances."""
    z = x.linear
    linear = LinearState(
        z.side_slip_rad,
        z.yaw_rate_rad_s,
        z.heading_error_rad,
        z.lateral_error_m,
        z.wheel_rad,
        z.wheel_rate_rad_s,
        z.curvature_1_m,
        z.curvature_rate_1_m_s,
        p.intervals[interval].side_slip_disturbance_rad_s,
        p.intervals[interval].yaw_disturbance_rad_s2,
    )
    later = interval + 1
    end_ns = p.intervals[later].start_ns if later < len(p.intervals) else NEVER_NS
    return MotionState(x.time_ns, linear, x.wheel, x.place, x.place_end_ns, interval, end_ns)


def has_finite_vehicle(z: LinearState) -> bool:
    """Whether the vehicle's state is finite, and not beyond LARGEST."""
    # Each is false for NaN too.
    return (
        abs(z.lateral_error_m) <= LARGEST
        and abs(z.heading_error_rad) <= LARGEST
        and abs(z.yaw_rate_rad_s) <= LARGEST
        and abs(z.side_slip_rad) <= LARGEST
    )


def with_vehicle(
    x: MotionState,
    side_slip_rad: float,
    yaw_rate_rad_s: float,
    heading_rad: float,
    lateral_m: float,
) -> MotionState:
    """Return the state with another vehicle's, but the same wheel and path."""
    linear = LinearState(side_slip_rad, yaw_rate_rad_s, heading_rad, lateral_m, *x.linear[4:])
    return x._replace(linear=linear)


Advance = Callable[[MotionParams, MotionState, int], MotionState]


class Motion:
    """The state of one motion; all properties are those at ``time_ns``, and finite.

    The state of an unstable, uncontrolled vehicle grows without bound, because (1) is linear. If it
    is no longer finite, the vehicle keeps its last finite state, while wheel and path continue;
    ``is_finite`` reports this.

    ``advance``  ``advance_motion``, or one with other equations of motion
    """

    def __init__(self, params: MotionParams, advance: Advance = advance_motion) -> None:
        self._params = params
        self._advance = advance
        self._state = start_motion(params)
        self._is_finite = True

    def command(self, steer_rad: float) -> None:
        """Apply a steering command (finite) to the actuator now."""
        self._state = command_motion(self._params, self._state, steer_rad)

    def disturb(self, params: MotionParams) -> None:
        """Let the one interval of other parameters begin now; all else in them is the same."""
        self._params = params
        self._state = _enter_interval(params, self._state, 0)

    def advance(self, to_ns: int) -> None:
        """Advance to ``to_ns``. Raises ValueError if that is in the past."""
        if to_ns < self._state.time_ns:
            raise ValueError(f"cannot move from {self._state.time_ns} ns back to {to_ns} ns")
        before = self._state
        if self._is_finite:
            self._state = self._advance(self._params, before, to_ns)
            self._is_finite = has_finite_vehicle(self._state.linear)
        if not self._is_finite:
            # With the vehicle at rest, since nothing else depends on its state.
            started = with_vehicle(before, 0.0, 0.0, 0.0, 0.0)
            after = advance_motion(self._params, started, to_ns)
            self._state = with_vehicle(after, *before.linear[:4])

    @property
    def path(self) -> Path:
        """The path."""
        return self._params.path

    @property
    def is_finite(self) -> bool:
        """Whether the vehicle's state has always been finite."""
        return self._is_finite

    @property
    def time_ns(self) -> int:
        """Time since the start of motion."""
        return self._state.time_ns

    @property
    def linear(self) -> LinearState:
        """All that is propagated in closed form."""
        return self._state.linear

    @property
    def lateral_error_m(self) -> float:
        """Lateral error y of the preview point, to the left of the path positive."""
        return self._state.linear.lateral_error_m

    @property
    def heading_error_rad(self) -> float:
        """Heading error Δψ against the path beside the preview point."""
        return self._state.linear.heading_error_rad

    @property
    def side_slip_rad(self) -> float:
        """Side slip angle β at the centre of gravity."""
        return self._state.linear.side_slip_rad

    @property
    def yaw_rate_rad_s(self) -> float:
        """Yaw rate r."""
        return self._state.linear.yaw_rate_rad_s

    @property
    def speed_m_s(self) -> float:
        """Speed V, constant."""
        return self._params.speed_m_s

    @property
    def wheel_rad(self) -> float:
        """Front wheel angle at the actuator, without a steering offset."""
        return self._state.linear.wheel_rad

    @property
    def is_limited(self) -> bool:
        """Whether the actuator's angle or rate limit shapes the wheel's motion."""
        return is_limited(self._state.wheel)

    @property
    def preview_curvature_1_m(self) -> float:
        """Curvature ρ of the path beside the preview point."""
        return self._state.linear.curvature_1_m

    @property
    def arc_length_m(self) -> float:
        """Arc length s of the path beside the preview point, over all laps."""
        return self._params.speed_m_s * (self._state.time_ns / NS_PER_S)

    @property
    def pose(self) -> Pose:
        """Position of the centre of gravity and heading of the vehicle."""
        return vehicle_pose(
            self._params.path,
            self.arc_length_m,
            self.heading_error_rad,
            self.lateral_error_m,
            self._params.preview_distance_m,
        )
