"""The moving vehicle: its state at any time, the last finite one once it grows beyond all bounds.

The motion itself is ``plant_emulator.vehicle.motion_events``.
"""

from collections import deque
from collections.abc import Callable
from typing import Any

from ..path.path import Pose, vehicle_pose
from .car.axle_use import AxleUse
from .car.car_motion import CarMotionParams, axle_use_of_car
from .exact_propagation import PSI, LinearState, Y
from .motion_choice import MOTIONS
from .motion_events import MotionState, with_vehicle
from .motion_parameters import MotionParams
from .single_track_model import VehicleParams

LARGEST = 1e150
"""A larger state counts as infinite, because figures of a run take its square."""


def has_finite_vehicle(z: LinearState) -> bool:
    """Whether the vehicle's state is finite, and not beyond LARGEST."""
    beta, r, psi, y, _, _, _, _, _, _ = z
    if beta * beta + r * r + psi * psi + y * y < LARGEST:
        return True
    # A NaN fails these comparisons too.
    return (
        -LARGEST <= y <= LARGEST
        and -LARGEST <= psi <= LARGEST
        and -LARGEST <= r <= LARGEST
        and -LARGEST <= beta <= LARGEST
    )


Advance = Callable[[MotionParams, MotionState, int], MotionState]
AnyMotionParams = MotionParams | CarMotionParams


class Motion:
    """The state of one motion; all properties are those at ``time_ns``, and finite.

    The state of an unstable, uncontrolled vehicle grows without bound, because (1) is linear. If it
    is no longer finite, the vehicle keeps its last finite state, while wheel and path continue;
    ``is_finite`` reports this. A car that has left its path is treated alike.

    ``advance``  advances the motion by equations of another package

    ``advance(to_ns)``      advances to a time; ValueError if that is in the past
    ``command(steer_rad)``  gives a steering command (finite) to the actuator now; it acts after
                            its dead time
    ``time_ns``    time since the start of motion
    ``linear``     everything that moves in closed form
    ``is_finite``  whether the vehicle's state has been finite so far
    ``preview_distance_m``  how far the preview point is ahead of the centre of gravity
    """

    def __init__(self, params: AnyMotionParams, advance: Advance | None = None) -> None:
        self._params = params
        self._steps = MOTIONS[type(params)]
        self._is_limited, self._place_of = self._steps.is_limited, self._steps.place
        self._command, self._event_ns = self._steps.command, self._steps.event_ns
        self.command: Callable[[float], None] = self._apply
        self.advance: Callable[[int], None] = self._advance_to
        if params.dead_time_ns:
            self.command, self.advance = self._delay, self._advance_and_apply
        self._advance: Callable[..., MotionState] = advance or self._steps.advance
        self._state: MotionState = self._steps.start(params)
        self.linear: LinearState
        self.time_ns, self.linear, _ = self._state
        self.is_finite = True
        self._waiting: deque[tuple[int, float]] = deque()
        self.path = params.path
        self.preview_distance_m = params.preview_distance_m

    def _delay(self, steer_rad: float) -> None:
        self._waiting.append((self.time_ns + self._params.dead_time_ns, steer_rad))

    def _apply(self, steer_rad: float) -> None:
        self._state = self._command(self._params, self._state, steer_rad)
        _, self.linear, _ = self._state

    def limit_speed(self, limit_m_s: float) -> None:
        """Let a car not exceed a speed from now on; a linear vehicle has no other than its own."""
        self._state = self._steps.limit(self._state, limit_m_s)

    def brake(self, brake_m_s2: float) -> None:
        """Let a car brake to a stop from now on, or no more (0)."""
        self._state = self._steps.brake(self._state, brake_m_s2)

    def disturb(self, params: AnyMotionParams) -> None:
        """Let the only interval of new parameters begin now; all else in them is the same."""
        self._params = params
        self._state = self._steps.disturb(params, self._state)
        _, self.linear, _ = self._state

    def _advance_and_apply(self, to_ns: int) -> None:
        while self._waiting and self._waiting[0][0] <= to_ns:
            due_ns, steer_rad = self._waiting.popleft()
            self._advance_to(due_ns)
            self._apply(steer_rad)
        self._advance_to(to_ns)

    def _advance_to(self, to_ns: int) -> None:
        if to_ns <= self.time_ns:
            if to_ns < self.time_ns:
                raise ValueError(f"cannot move from {self.time_ns} ns back to {to_ns} ns")
            if self._event_ns(self._state) > to_ns:
                return
        if self.is_finite:
            state = self._advance(self._params, self._state, to_ns)
            time_ns, linear, _ = state
            if has_finite_vehicle(linear):
                self._state, self.time_ns, self.linear = state, time_ns, linear
                return
            self.is_finite = False
        # Restarted with the vehicle at rest: wheel and path do not depend on its state.
        started = with_vehicle(self._state, 0.0, 0.0, 0.0, 0.0)
        after: MotionState = self._steps.advance(self._params, started, to_ns)
        beta, r, psi, y, _, _, _, _, _, _ = self.linear
        self._state = state = with_vehicle(after, beta, r, psi, y)
        self.time_ns, self.linear, _ = state

    def is_limited(self) -> bool:
        """Return whether the actuator's angle or rate limit shapes the wheel's motion."""
        return bool(self._is_limited(self._state))

    def rack_force_n(self, vehicle: VehicleParams, trail_m: float, arm_m: float) -> float:
        """Return the force on the rack, left positive; without a rack, that of trail and arm."""
        return float(self._steps.rack_force_n(self._params, self._state, vehicle, trail_m, arm_m))

    @property
    def axle_use(self) -> AxleUse | None:
        """What the axles bear and give; None unless this is the built-in car."""
        if not isinstance(self._params, CarMotionParams):
            return None
        state: Any = self._state
        return axle_use_of_car(self._params, state)

    @property
    def place(self) -> tuple[float, float]:
        """Arc length of the path beside the preview point over all laps [m], and speed [m/s]."""
        arc_length_m, speed_m_s = self._place_of(self._params, self._state)
        return arc_length_m, speed_m_s

    @property
    def arc_length_m(self) -> float:
        """Arc length of ``place``."""
        arc_length_m, _ = self.place
        return arc_length_m

    @property
    def speed_m_s(self) -> float:
        """Speed of ``place``."""
        _, speed_m_s = self.place
        return speed_m_s

    @property
    def pose(self) -> Pose:
        """Position of the centre of gravity and heading of the vehicle."""
        return vehicle_pose(
            self.path, self.arc_length_m, self.linear[PSI], self.linear[Y], self.preview_distance_m
        )
