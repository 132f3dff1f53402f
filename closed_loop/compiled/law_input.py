"""The input of a law that looks back in a compiled run, tick by tick, besides the newest error.

Most laws read only the newest error, their last command, and speed and curvature of the vehicle:
their inbox is None, which costs nothing. For a law that reads more, the messages of each sample are
recorded when it is taken, and passed in their order of arrival (``closed_loop.compiled.schedule``)
to the steps of ``controller.history.history``.
"""

import math
from enum import IntEnum
from typing import Any

import numpy as np
from numba.extending import register_jitable

from ...controller.history.history import (
    command_step,
    echo_step,
    error_step,
    loop_delay_at,
    path_step,
    yaw_rate_step,
)
from ...controller.history.plan import ROW_LENGTH, limit_plan
from ...controller.law_interface import VehicleReading
from ...controller.limits.steer_limits import SteerLimits
from ...dbc.codec.protection import COUNTERS
from ...dbc.messages import (
    COMMAND_COUNTERS,
    LateralError,
    Message,
    PathAhead,
    SteeringCommand,
    SteeringPlan,
    SteeringStatus,
    SteeringStatusCode,
    VehicleState,
    limits,
    resolutions,
)
from ...plant_emulator.sensors.path_ahead import CURVATURES
from ...plant_emulator.steering.control_unit import status_of
from ...plant_emulator.steering.hold_and_fallback import GuardState
from ...plant_emulator.steering.plan_buffer import has_run_out, planned_rad
from ...plant_emulator.vehicle.exact_propagation import LinearState
from .inlined_functions import INLINE
from .loop_records import (
    ARRIVED_NS,
    MEASURED,
    MESSAGE,
    OF_SAMPLE,
    SEEN_CURVATURE,
    SEEN_HEADING,
    SEEN_SPEED,
    SEEN_WHEEL,
    SEEN_YAW_RATE,
    SENT_AT,
    Inbox,
    Instants,
    Known,
    Now,
    Records,
)
from .step_functions import register

register(error_step, echo_step, command_step, path_step, yaw_rate_step, loop_delay_at)
register(limit_plan, has_run_out, planned_rad, status_of)


class Uplink(IntEnum):
    """Messages of a sample, as they enter the uplink, and that with a pace of its own."""

    LATERAL_ERROR = 0
    STEERING_STATUS = 1
    VEHICLE_STATE = 2
    PATH_AHEAD = 3
    STEERING_FORCE = 4


_LATERAL_ERROR, _STEERING_STATUS, _VEHICLE_STATE, _, _ = map(int, Uplink)


def wire(message: type[Message], signal: str) -> tuple[float, float]:
    """Return a signal's largest value, to either side, and its resolution: for ``on_wire``."""
    return limits(message)[signal].maximum, resolutions(message)[signal]


# Resolutions and ranges on the wire; compiled code takes module constants as numbers.
LATERAL_ERROR_RESOLUTION_M = resolutions(LateralError)["lateral_error_m"]
LATERAL_ERROR_M_MAX = limits(LateralError)["lateral_error_m"].maximum
STEER_RESOLUTION_RAD = resolutions(SteeringCommand)["steer_rad"]
_PLAN_RESOLUTION_RAD = resolutions(SteeringPlan)["steer_0_rad"]
_DRIVER_STEERS = int(SteeringStatusCode.DRIVER_STEERS)
_WHEEL_RAD = wire(SteeringStatus, "wheel_angle_rad")
_HEADING_RESOLUTION_RAD = resolutions(LateralError)["heading_error_rad"]
_YAW_RATE_RAD_S = wire(VehicleState, "yaw_rate_rad_s")
_SPEED_M_S = wire(VehicleState, "speed_m_s")
_CURVATURE_1_M = wire(VehicleState, "preview_curvature_1_m")
_AHEAD_LOW, _AHEAD_HIGH = CURVATURES
_PATH_RESOLUTION_1_M = resolutions(PathAhead)["curvature_0_1_m"]


def quantised(value: float, resolution: float) -> float:
    """Return a value as a signal carries it: ``round(value / resolution) * resolution``.

    It is rounded as a float, because converting to an integer and back costs more than the law.
    0.0 is added because rounding can give a negative zero, which an integer cannot.
    """
    return float((np.rint(value / resolution) + 0.0) * resolution)


register(quantised)


@register_jitable(**INLINE)
def on_wire(value: float, wired: tuple[float, float]) -> float:
    """Return a value as a signal carries it, within its range; ``wired``: of ``wire``."""
    most, resolution = wired
    return quantised(min(max(value, -most), most), resolution)


@register_jitable(**INLINE)
def speed_on_wire_m_s(speed_m_s: float) -> float:
    """Return the speed as VEHICLE_STATE carries it."""
    return on_wire(speed_m_s, _SPEED_M_S)


@register_jitable(**INLINE)
def curvature_on_wire_1_m(curvature_1_m: float) -> float:
    """Return the curvature at the preview point as VEHICLE_STATE carries it."""
    return on_wire(curvature_1_m, _CURVATURE_1_M)


@register_jitable(**INLINE)
def wheel_on_wire_rad(wheel_rad: float) -> float:
    """Return the angle of the wheel as STEERING_STATUS carries it."""
    return on_wire(wheel_rad, _WHEEL_RAD)


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


@register_jitable(**INLINE)
def record_signals(inbox: Inbox, sample: int, z: LinearState, guard: GuardState) -> None:
    """Record the signals of a sample other than the lateral error and the speed."""
    _, yaw_rate_rad_s, heading_rad, _, wheel_rad, _, curvature_1_m, _, _, _ = z
    at, signals = np.uintp(sample), inbox.signals
    noise_rad = inbox.noise[SEEN_HEADING, at]
    yaw_rate_rad_s = yaw_rate_rad_s + inbox.noise[SEEN_YAW_RATE, at]
    signals[SEEN_HEADING, at] = heading_on_wire_rad(heading_rad, noise_rad)
    signals[SEEN_YAW_RATE, at] = on_wire(yaw_rate_rad_s, _YAW_RATE_RAD_S)
    signals[SEEN_CURVATURE, at] = curvature_on_wire_1_m(curvature_1_m)
    signals[SEEN_WHEEL, at] = wheel_on_wire_rad(wheel_rad)
    inbox.status[at] = status_of(guard, False)


@register_jitable(**INLINE)
def record_driver(inbox: Inbox, sample: int) -> None:
    """Record that the driver steers at a sample."""
    inbox.status[sample] = _DRIVER_STEERS


@register_jitable(**INLINE)
def _write_ahead_1_m(
    path: Any, arc_length_m: float, spacing_m: float, row: Any, low_1_m: float, high_1_m: float
) -> None:
    """Write the values of one place into a row, as ``path.path.curvature`` has them."""
    for index in range(len(row)):
        along_m = arc_length_m + index * spacing_m
        if path.closed:
            lap = along_m // path.length_m
            along_m -= lap * path.length_m
        piece, end = 0, len(path.start_m)
        while end - piece > 1:
            middle = (piece + end) // 2
            if path.start_m[middle] <= along_m:
                piece = middle
            else:
                end = middle
        slope_1_m2 = path.curvature_slope_1_m2[piece]
        curvature_1_m = path.curvature_1_m[piece] + slope_1_m2 * (along_m - path.start_m[piece])
        row[index] = min(max(curvature_1_m, low_1_m), high_1_m)


@register_jitable(**INLINE)
def record_ahead(inbox: Inbox, p: Any, sample: int, arc_length_m: float, speed_m_s: float) -> None:
    """Record the speed of a sample, and what is ahead on the path."""
    inbox.signals[SEEN_SPEED, sample] = speed_on_wire_m_s(speed_m_s)
    if len(inbox.path_ahead_1_m) > 0 and sample % inbox.samples_per_path == 0:
        row = inbox.path_ahead_1_m[sample // inbox.samples_per_path]
        _write_ahead_1_m(p.path, arc_length_m, inbox.path_spacing_m, row, _AHEAD_LOW, _AHEAD_HIGH)
        for index in range(len(row)):
            row[index] = quantised(row[index], _PATH_RESOLUTION_1_M)


@register_jitable(**INLINE)
def take_arrivals(inbox: Inbox, x: Known, s: Instants, r: Records, now_ns: int) -> Known:
    """Return the knowledge with all arrivals up to now."""
    arrivals, errors, echoes, yaw_rates, commands, vehicle_sample, vehicle_ns, path_end = x
    params, rings, signals = inbox.params, inbox.rings, inbox.signals
    while arrivals < inbox.arrivals.shape[1] and inbox.arrivals[ARRIVED_NS, arrivals] <= now_ns:
        came_ns, sample = inbox.arrivals[ARRIVED_NS, arrivals], inbox.arrivals[OF_SAMPLE, arrivals]
        message, counter = inbox.arrivals[MESSAGE, arrivals], sample % COUNTERS
        if message == _LATERAL_ERROR:
            error_m, heading_rad = r.samples[MEASURED, sample], signals[SEEN_HEADING, sample]
            errors = error_step(
                params, rings, errors, echoes, counter, error_m, heading_rad, came_ns
            )
        elif message == _STEERING_STATUS:
            command = r.command[sample]
            applied = 0
            if command >= 0:
                applied = (s.commands[SENT_AT, command] - inbox.first_tick) % COMMAND_COUNTERS
            code, wheel_rad = inbox.status[sample], signals[SEEN_WHEEL, sample]
            echoes = echo_step(
                params, rings, echoes, errors, commands, counter, applied, code, wheel_rad, came_ns
            )
        elif message == _VEHICLE_STATE:
            vehicle_sample, vehicle_ns = sample, came_ns
            counter = sample // inbox.samples_per_path % COUNTERS
            yaw_rate_rad_s = signals[SEEN_YAW_RATE, sample]
            yaw_rates = yaw_rate_step(
                params, rings, yaw_rates, errors, counter, yaw_rate_rad_s, came_ns
            )
        else:
            speed_m_s = signals[SEEN_SPEED, vehicle_sample] if vehicle_sample >= 0 else 0.0
            ahead_1_m = inbox.path_ahead_1_m[sample // inbox.samples_per_path]
            path_end = path_step(
                params, rings, path_end, errors, counter, inbox.path_spacing_m, ahead_1_m, speed_m_s
            )
        arrivals += 1
    return Known(
        arrivals, errors, echoes, yaw_rates, commands, vehicle_sample, vehicle_ns, path_end
    )


@register_jitable(**INLINE)
def with_command(inbox: Inbox, x: Known, tick: int, sent_rad: float, is_planned: bool) -> Known:
    """Return the knowledge with a tick's command."""
    period = tick - inbox.first_tick
    commands = command_step(inbox.rings, x.commands, period, sent_rad, is_planned)
    return Known(
        *(x.arrivals, x.errors, x.echoes, x.yaw_rates, commands),
        *(x.vehicle_sample, x.vehicle_ns, x.path_end),
    )


@register_jitable(**INLINE)
def limit_plan_of(inbox: Inbox, limits: SteerLimits, acting: int, tick: int) -> None:
    """Limit the plan of a tick."""
    plans, mask = inbox.rings.plans, len(inbox.rings.plans) - 1
    period = tick - inbox.first_tick
    row, before = plans[period & mask], plans[(period - 1) & mask]
    limit_plan(limits, inbox.periods_per_sample, acting, before, row)


@register_jitable(**INLINE)
def carries_plan(inbox: Inbox, tick: int) -> bool:
    """Return whether a tick has sent a plan, which the plant's buffer then holds."""
    row = inbox.rings.plans[(tick - inbox.first_tick) & (len(inbox.rings.plans) - 1)]
    if len(inbox.rings.plans) == 1 or row[1] == 0.0:
        return False
    inbox.buffer[0], inbox.buffer[1] = row[0], row[1]
    for index in range(2, ROW_LENGTH):
        inbox.buffer[index] = quantised(row[index], _PLAN_RESOLUTION_RAD)
    return True


@register_jitable(**INLINE)
def play(inbox: Inbox, sample: int) -> float:
    """Return what the buffer has for a sample, NaN for nothing [rad]."""
    age, spacing = (sample - int(inbox.buffer[0])) % COUNTERS, int(inbox.buffer[1])
    if has_run_out(age, spacing):
        return math.nan
    values_rad: Any = inbox.buffer[2:]
    return planned_rad(age, spacing, values_rad)


@register_jitable(**INLINE)
def known_now(inbox: Inbox, x: Known, tick: int, now_ns: int) -> Now:
    """Return what is known at a tick."""
    speed_m_s = yaw_rate_rad_s = curvature_1_m = 0.0
    is_stale = False
    if x.vehicle_sample >= 0:
        speed_m_s = inbox.signals[SEEN_SPEED, x.vehicle_sample]
        yaw_rate_rad_s = inbox.signals[SEEN_YAW_RATE, x.vehicle_sample]
        curvature_1_m = inbox.signals[SEEN_CURVATURE, x.vehicle_sample]
        is_stale = now_ns - x.vehicle_ns > inbox.params.limits.vehicle_state_ns
    period = tick - inbox.first_tick
    loop_delay = loop_delay_at(
        inbox.params, x.errors, x.echoes, x.yaw_rates, x.path_end, x.vehicle_ns, period, now_ns
    )
    return Now(VehicleReading(speed_m_s, yaw_rate_rad_s, curvature_1_m, is_stale), loop_delay)
