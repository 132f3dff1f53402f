"""The input of a law that looks back in a compiled run, tick by tick, besides the newest error.

Most laws read only the newest error, their last command, and speed and curvature of the vehicle:
their inbox is None, which costs nothing. For a law that reads more, the messages of each sample are
recorded when it is taken, and passed in their order of arrival (``closed_loop.compiled.schedule``)
to the steps of ``controller.history.history``.
"""

import math
from collections.abc import Callable
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import overload, register_jitable

from ...controller.history.history import (
    NO_COMMANDS,
    NO_ECHOES,
    NO_ERRORS,
    Commands,
    Echoes,
    Errors,
    HistoryParams,
    command_step,
    echo_step,
    error_step,
    loop_delay_at,
    path_step,
)
from ...controller.history.plan import ROW_LENGTH, limit_plan
from ...controller.law_interface import NO_HISTORY, History, LoopDelay, VehicleReading
from ...controller.limits.steer_limits import SteerLimits
from ...dbc.codec.protection import COUNTERS
from ...dbc.messages import (
    COMMAND_COUNTERS,
    LateralError,
    PathAhead,
    SteeringCommand,
    SteeringPlan,
    SteeringStatus,
    VehicleState,
    limits,
    resolutions,
)
from ...plant_emulator.sensors.path_ahead import CURVATURES
from ...plant_emulator.steering.control_unit import status_of
from ...plant_emulator.steering.hold_and_fallback import GuardState
from ...plant_emulator.steering.plan_buffer import has_run_out, planned_rad
from ...plant_emulator.vehicle.car.car_motion import CarMotionParams
from ...plant_emulator.vehicle.exact_propagation import LinearState
from ...runtime.array_types import FloatArray, IntArray
from .along_path import write_ahead_1_m
from .inlined_functions import INLINE
from .memory import write
from .step_functions import place_of, register


class Uplink(IntEnum):
    """Messages of a sample, as they enter the uplink, and that with a pace of its own."""

    LATERAL_ERROR = 0
    STEERING_STATUS = 1
    VEHICLE_STATE = 2
    PATH_AHEAD = 3
    STEERING_FORCE = 4


_LATERAL_ERROR, _STEERING_STATUS, _VEHICLE_STATE, _, _ = map(int, Uplink)

# Resolutions and ranges on the wire; compiled code takes module constants as numbers.
LATERAL_ERROR_RESOLUTION_M = resolutions(LateralError)["lateral_error_m"]
LATERAL_ERROR_M_MAX = limits(LateralError)["lateral_error_m"].maximum
STEER_RESOLUTION_RAD = resolutions(SteeringCommand)["steer_rad"]
_PLAN_RESOLUTION_RAD = resolutions(SteeringPlan)["steer_0_rad"]
_WHEEL_RESOLUTION_RAD = resolutions(SteeringStatus)["wheel_angle_rad"]
_WHEEL_RAD_MAX = limits(SteeringStatus)["wheel_angle_rad"].maximum
_HEADING_RESOLUTION_RAD = resolutions(LateralError)["heading_error_rad"]
_YAW_RATE_RESOLUTION_RAD_S = resolutions(VehicleState)["yaw_rate_rad_s"]
_YAW_RATE_RAD_S_MAX = limits(VehicleState)["yaw_rate_rad_s"].maximum
_SPEED_RESOLUTION_M_S = resolutions(VehicleState)["speed_m_s"]
_SPEED_M_S_MAX = limits(VehicleState)["speed_m_s"].maximum
_AHEAD_LOW, _AHEAD_HIGH = CURVATURES
PATH_RESOLUTION_1_M = resolutions(PathAhead)["curvature_0_1_m"]
_CURVATURE_RESOLUTION_1_M = resolutions(VehicleState)["preview_curvature_1_m"]
_CURVATURE_1_M_MAX = limits(VehicleState)["preview_curvature_1_m"].maximum


class Inbox(NamedTuple):
    """The controller's input: arrays of shape (arrivals,), then of shape (samples,), then numbers.

    ``arrival_*``       messages that the controller accepts, by ``Uplink``, in order of arrival
    ``measured_*``      as the bus carries them, like ``wheel_rad``; written during the run, but a
                        constant speed and what is ahead on the path before it
    ``status``          code of STEERING_STATUS, with APPLYING for LIMITED; written during the run
    ``buffer``          the plan that the plant plays, as the bus carries it: values of its row
    ``path_ahead_1_m``  values of each PATH_AHEAD, as on the wire; one of every ``samples_per_path``
    ``played_rad``      what a plan has let act at a sample, else NaN; written during the run
    """

    params: HistoryParams
    rings: History
    arrival_ns: IntArray
    arrival_message: IntArray
    arrival_sample: IntArray
    heading_noise_rad: FloatArray
    yaw_rate_noise_rad_s: FloatArray
    measured_heading_rad: FloatArray
    measured_yaw_rate_rad_s: FloatArray
    measured_curvature_1_m: FloatArray
    wheel_rad: FloatArray
    status: IntArray
    measured_speed_m_s: FloatArray
    periods_per_sample: float
    buffer: FloatArray
    played_rad: FloatArray
    samples_per_path: int
    path_spacing_m: float
    path_ahead_1_m: FloatArray


class Known(NamedTuple):
    """What the controller has received.

    ``arrivals``    messages that have arrived so far
    ``vehicle_*``   sample and arrival of the newest VEHICLE_STATE, -1 for none
    ``path_end``    as in ``LoopDelay``
    """

    arrivals: int
    errors: Errors
    echoes: Echoes
    commands: Commands
    vehicle_sample: int
    vehicle_ns: int
    path_end: int


class Now(NamedTuple):
    """What the controller knows at a tick, besides errors and commands."""

    vehicle: VehicleReading
    loop_delay: LoopDelay


NOW_UNKNOWN = Now(VehicleReading(0.0, 0.0, 0.0, False), LoopDelay(0, -1, -1, 0.0, False, -1))
NOTHING_KNOWN = Known(0, NO_ERRORS, NO_ECHOES, NO_COMMANDS, -1, -1, -1)


def quantised(value: float, resolution: float) -> float:
    """Return a value as a signal carries it: ``round(value / resolution) * resolution``.

    It is rounded as a float, because converting to an integer and back costs more than the law.
    0.0 is added because rounding can give a negative zero, which an integer cannot.
    """
    return float((np.rint(value / resolution) + 0.0) * resolution)


register(quantised)


@register_jitable(**INLINE)
def speed_on_wire_m_s(speed_m_s: float) -> float:
    """Return the speed as VEHICLE_STATE carries it."""
    return quantised(min(speed_m_s, _SPEED_M_S_MAX), _SPEED_RESOLUTION_M_S)


@register_jitable(**INLINE)
def curvature_on_wire_1_m(curvature_1_m: float) -> float:
    """Return the curvature at the preview point as VEHICLE_STATE carries it."""
    clamped_1_m = min(max(curvature_1_m, -_CURVATURE_1_M_MAX), _CURVATURE_1_M_MAX)
    return quantised(clamped_1_m, _CURVATURE_RESOLUTION_1_M)


@register_jitable(**INLINE)
def wheel_on_wire_rad(wheel_rad: float) -> float:
    """Return the angle of the wheel as STEERING_STATUS carries it."""
    clamped_rad = min(max(wheel_rad, -_WHEEL_RAD_MAX), _WHEEL_RAD_MAX)
    return quantised(clamped_rad, _WHEEL_RESOLUTION_RAD)


def _nothing(*_: Any) -> None:
    """Do nothing."""


def _choosing(
    with_inbox: Callable[..., Any], without: Callable[..., Any] = _nothing
) -> Callable[..., Any]:
    """Return a function for compiled code: ``with_inbox``, or ``without`` an inbox."""

    def chosen(*_: Any) -> Any:
        raise NotImplementedError("for compiled code")

    def of_type(inbox: Any, *_: Any) -> Callable[..., Any]:
        return without if isinstance(inbox, types.NoneType) else with_inbox

    overload(chosen, strict=False, jit_options=INLINE)(of_type)
    return chosen


@register_jitable(**INLINE)
def _in_one_turn(angle_rad: float) -> float:
    """Return ``math.remainder(angle_rad, math.tau)``, which does not compile; exact, too."""
    rest_rad = float(np.fmod(angle_rad, math.tau))
    if rest_rad > math.pi:
        return rest_rad - math.tau
    if rest_rad < -math.pi:
        return rest_rad + math.tau
    return rest_rad


@register_jitable(**INLINE)
def heading_on_wire_rad(heading_rad: float, noise_rad: float) -> float:
    """Return the heading error, with the sensor's noise, as LATERAL_ERROR carries it."""
    return quantised(_in_one_turn(heading_rad + noise_rad), _HEADING_RESOLUTION_RAD)


def _record(inbox: Inbox, sample: int, z: LinearState, guard: GuardState) -> None:
    _, yaw_rate_rad_s, heading_rad, _, wheel_rad, _, curvature_1_m, _, _, _ = z
    noise_rad = inbox.heading_noise_rad[sample]
    yaw_rate_rad_s = yaw_rate_rad_s + inbox.yaw_rate_noise_rad_s[sample]
    yaw_rate_rad_s = min(max(yaw_rate_rad_s, -_YAW_RATE_RAD_S_MAX), _YAW_RATE_RAD_S_MAX)
    inbox.measured_heading_rad[sample] = heading_on_wire_rad(heading_rad, noise_rad)
    inbox.measured_yaw_rate_rad_s[sample] = quantised(yaw_rate_rad_s, _YAW_RATE_RESOLUTION_RAD_S)
    inbox.measured_curvature_1_m[sample] = curvature_on_wire_1_m(curvature_1_m)
    inbox.wheel_rad[sample] = wheel_on_wire_rad(wheel_rad)
    inbox.status[sample] = status_of(guard, False)


def _record_ahead(inbox: Inbox, p: Any, sample: int, arc_length_m: float, speed: float) -> None:
    inbox.measured_speed_m_s[sample] = speed_on_wire_m_s(speed)
    if len(inbox.path_ahead_1_m) > 0 and sample % inbox.samples_per_path == 0:
        row = inbox.path_ahead_1_m[sample // inbox.samples_per_path]
        write_ahead_1_m(p.path, arc_length_m, inbox.path_spacing_m, row, _AHEAD_LOW, _AHEAD_HIGH)
        for index in range(len(row)):
            row[index] = quantised(row[index], PATH_RESOLUTION_1_M)


def _take_arrivals(inbox: Inbox, x: Known, s: Any, r: Any, now_ns: int) -> Known:
    arrivals, errors, echoes, commands, vehicle_sample, vehicle_ns, path_end = x
    params, rings = inbox.params, inbox.rings
    while arrivals < len(inbox.arrival_ns) and inbox.arrival_ns[arrivals] <= now_ns:
        came_ns, sample = inbox.arrival_ns[arrivals], inbox.arrival_sample[arrivals]
        message, counter = inbox.arrival_message[arrivals], sample % COUNTERS
        if message == _LATERAL_ERROR:
            error_m, heading_rad = r.measured_m[sample], inbox.measured_heading_rad[sample]
            errors = error_step(
                params, rings, errors, echoes, counter, error_m, heading_rad, came_ns
            )
        elif message == _STEERING_STATUS:
            command = r.command[sample]
            applied = s.command_tick[command] % COMMAND_COUNTERS if command >= 0 else 0
            code, wheel_rad = inbox.status[sample], inbox.wheel_rad[sample]
            echoes = echo_step(
                params, rings, echoes, errors, commands, counter, applied, code, wheel_rad, came_ns
            )
        elif message == _VEHICLE_STATE:
            vehicle_sample, vehicle_ns = sample, came_ns
        else:
            speed_m_s = inbox.measured_speed_m_s[vehicle_sample] if vehicle_sample >= 0 else 0.0
            ahead_1_m = inbox.path_ahead_1_m[sample // inbox.samples_per_path]
            path_end = path_step(
                params, rings, path_end, errors, counter, inbox.path_spacing_m, ahead_1_m, speed_m_s
            )
        arrivals += 1
    return Known(arrivals, errors, echoes, commands, vehicle_sample, vehicle_ns, path_end)


def _take_command(inbox: Inbox, x: Known, tick: int, sent_rad: float, is_planned: bool) -> Known:
    commands = command_step(inbox.rings, x.commands, tick, sent_rad, is_planned)
    return Known(
        x.arrivals, x.errors, x.echoes, commands, x.vehicle_sample, x.vehicle_ns, x.path_end
    )


def _write_plan(inbox: Inbox, limits: SteerLimits, acting: int, tick: int) -> None:
    if acting >= 0:
        plans, mask = inbox.rings.plans, len(inbox.rings.plans) - 1
        row, before = plans[tick & mask], plans[(tick - 1) & mask]
        limit_plan(limits, inbox.periods_per_sample, acting, before, row)


def _carries_plan(inbox: Inbox, tick: int) -> bool:
    row = inbox.rings.plans[tick & (len(inbox.rings.plans) - 1)]
    if len(inbox.rings.plans) == 1 or row[1] == 0.0:
        return False
    inbox.buffer[0], inbox.buffer[1] = row[0], row[1]
    for index in range(2, ROW_LENGTH):
        inbox.buffer[index] = quantised(row[index], _PLAN_RESOLUTION_RAD)
    return True


def _play(inbox: Inbox, sample: int) -> float:
    age, spacing = (sample - int(inbox.buffer[0])) % COUNTERS, int(inbox.buffer[1])
    if has_run_out(age, spacing):
        return math.nan
    values_rad: Any = inbox.buffer[2:]
    return planned_rad(age, spacing, values_rad)


def _record_played(inbox: Inbox, sample: int, steer_rad: float) -> None:
    inbox.played_rad[sample] = steer_rad


def _note_vehicle(
    _inbox: None, now: Any, _x: None, s: Any, r: Any, tick: int, _now_ns: int
) -> None:
    if len(s.tick_state) > 0 and s.tick_state[tick] >= 0:
        sample = np.uintp(s.tick_state[tick])
        speed_m_s = speed_on_wire_m_s(r.speed_m_s[sample])
        curvature_1_m = curvature_on_wire_1_m(r.curvature_1_m[sample])
        vehicle = VehicleReading(speed_m_s, 0.0, curvature_1_m, s.tick_is_stale[tick] != 0)
        write(now, Now(vehicle, NOW_UNKNOWN.loop_delay))


def _note_now(inbox: Inbox, now: Any, x: Known, _s: Any, _r: Any, tick: int, now_ns: int) -> None:
    speed_m_s = yaw_rate_rad_s = curvature_1_m = 0.0
    is_stale = False
    if x.vehicle_sample >= 0:
        speed_m_s = inbox.measured_speed_m_s[x.vehicle_sample]
        yaw_rate_rad_s = inbox.measured_yaw_rate_rad_s[x.vehicle_sample]
        curvature_1_m = inbox.measured_curvature_1_m[x.vehicle_sample]
        is_stale = now_ns - x.vehicle_ns > inbox.params.limits.vehicle_state_ns
    loop_delay = loop_delay_at(
        inbox.params, x.errors, x.echoes, x.path_end, x.vehicle_ns, tick, now_ns
    )
    write(now, Now(VehicleReading(speed_m_s, yaw_rate_rad_s, curvature_1_m, is_stale), loop_delay))


record_signals = _choosing(_record)
"""(inbox, sample, linear, guard): records the signals of a sample other than the lateral error."""
take_arrivals = _choosing(_take_arrivals)
"""(inbox, known, schedule, records, now_ns): returns the knowledge with all arrivals up to now."""
take_command = _choosing(_take_command)
"""(inbox, known, tick, sent_rad, is_planned): returns the knowledge with a tick's command."""
write_plan = _choosing(_write_plan)
"""(inbox, limits, acting, tick): limits the plan of a tick, if there is one."""
carries_plan = _choosing(_carries_plan, lambda *_: False)
"""(inbox, tick): whether a tick has sent a plan, which the plant's buffer then holds."""
play = _choosing(_play, lambda *_: math.nan)
"""(inbox, sample): returns what the buffer has for a sample, NaN for nothing [rad]."""
record_played = _choosing(_record_played)
"""(inbox, sample, steer_rad): records what a plan lets act at a sample."""
nothing_known = _choosing(lambda _inbox: NOTHING_KNOWN)
"""(inbox): returns the knowledge at the start."""
inbox_history = _choosing(lambda inbox: inbox.rings, lambda _inbox: NO_HISTORY)
"""(inbox): returns the history that laws read."""
note_now = _choosing(_note_now, _note_vehicle)
"""(inbox, now, known, schedule, records, tick, now_ns): writes what is known at a tick."""


_record_ahead_if_read = _choosing(_record_ahead)


def record_place(*_: Any) -> Any:
    """Record the place and the speed of a car, for compiled code; takes ``_record_place``'s.

    Those of a linear vehicle are known beforehand.
    """
    raise NotImplementedError("for compiled code")


def _record_place(params: Any, inbox: Any, r: Any, sample: int, x: Any) -> None:
    arc_length_m, speed_m_s = place_of(params, x)
    r.arc_length_m[sample], r.speed_m_s[sample] = arc_length_m, speed_m_s
    _record_ahead_if_read(inbox, params, sample, arc_length_m, speed_m_s)


@overload(record_place, strict=False, jit_options=INLINE)
def _record_place_of_car(params: Any, *_: Any) -> Callable[..., Any]:
    return _record_place if params.instance_class is CarMotionParams else _nothing
