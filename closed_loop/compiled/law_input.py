"""The input of a law that looks back in a compiled run, tick by tick, besides the newest error.

Most laws read only the newest error and their last command: their wire is None, which costs
nothing. For a law that looks back, the messages of each sample are recorded when it is taken, and
passed in order of arrival (``closed_loop.compiled.wire_plan``) to the steps of
``controller.history.history``.
"""

import math
from collections.abc import Callable
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import overload

from ...controller.history.history import (
    NO_COMMANDS,
    NO_ECHOES,
    NO_ERRORS,
    Commands,
    Echoes,
    Errors,
    HistoryParams,
    Rings,
    command_step,
    echo_step,
    error_step,
    history_of,
    loop_delay_at,
    path_step,
)
from ...controller.history.plan import ROW_LENGTH, limit_plan
from ...controller.interface.law import NO_HISTORY, LoopDelay, VehicleReading
from ...controller.interface.steer_limits import SteerLimits
from ...dbc.codec.protection import COUNTERS
from ...dbc.messages import COMMAND_COUNTERS
from ...plant_emulator.steering.control_unit import status_of
from ...plant_emulator.steering.hold_and_fallback import GuardState
from ...plant_emulator.steering.plan_buffer import has_run_out, planned_rad
from ...plant_emulator.vehicle.exact_propagation import LinearState
from ...runtime.array_types import FloatArray, IntArray
from .compilation import compiled_inline, compiled_inside
from .memory import write


class Uplink(IntEnum):
    """Messages of a sample, in the order in which they enter the uplink."""

    LATERAL_ERROR = 0
    STEERING_STATUS = 1
    VEHICLE_STATE = 2
    PATH_AHEAD = 3


_LATERAL_ERROR, _STEERING_STATUS, _VEHICLE_STATE, _ = map(int, Uplink)


class Wire(NamedTuple):
    """The controller's input: arrays of shape (arrivals,), then of shape (samples,), then numbers.

    ``arrival_*``       messages that the controller accepts, by ``Uplink``, in order of arrival
    ``measured_*``      as on the wire, like ``wheel_rad``; written during the run
    ``status``          code of STEERING_STATUS, with APPLYING for LIMITED; written during the run
    ``*_resolution_*``  of the signals, and the ranges they are clamped to
    ``buffer``          the plan that the plant plays, as on the wire: values of its row
    ``path_ahead_1_m``  values of each PATH_AHEAD, as on the wire; one of every ``samples_per_path``
    ``played_rad``      what a plan has let act at a sample, else NaN; written during the run
    """

    params: HistoryParams
    rings: Rings
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
    speed_m_s: float
    heading_resolution_rad: float
    yaw_rate_resolution_rad_s: float
    yaw_rate_rad_s_max: float
    curvature_resolution_1_m: float
    curvature_1_m_max: float
    wheel_resolution_rad: float
    wheel_rad_max: float
    steer_resolution_rad: float
    periods_per_sample: float
    buffer: FloatArray
    played_rad: FloatArray
    samples_per_path: int
    path_spacing_m: float
    path_ahead_1_m: FloatArray


class Known(NamedTuple):
    """What the controller knows of the wire.

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


@compiled_inline
def on_wire(value: float, resolution: float) -> float:
    """Return a value as a signal carries it: ``round(value / resolution) * resolution``.

    It is rounded as a float, because converting to an integer and back costs more than the law.
    0.0 is added because rounding can give a negative zero, which an integer cannot.
    """
    return float((np.rint(value / resolution) + 0.0) * resolution)


def _choosing(with_wire: Callable[..., Any], without: Any = None) -> Callable[..., Any]:
    """Return a function for compiled code: ``with_wire``, or a constant where the wire is None."""

    def chosen(*_: Any) -> Any:
        raise NotImplementedError("for compiled code")

    def constant(*_: Any) -> Any:
        return without

    def of_type(wire: Any, *_: Any) -> Callable[..., Any]:
        return constant if isinstance(wire, types.NoneType) else with_wire

    overload(chosen, strict=False, jit_options={"forceinline": True})(of_type)
    return chosen


@compiled_inside
def _in_one_turn(angle_rad: float) -> float:
    """Return ``math.remainder(angle_rad, math.tau)``, which does not compile; exact, too."""
    rest_rad = float(np.fmod(angle_rad, math.tau))
    if rest_rad > math.pi:
        return rest_rad - math.tau
    if rest_rad < -math.pi:
        return rest_rad + math.tau
    return rest_rad


def _record(w: Wire, sample: int, z: LinearState, guard: GuardState) -> None:
    _, yaw_rate_rad_s, heading_rad, _, wheel_rad, _, curvature_1_m, _, _, _ = z
    heading_rad = _in_one_turn(heading_rad + w.heading_noise_rad[sample])
    yaw_rate_rad_s = yaw_rate_rad_s + w.yaw_rate_noise_rad_s[sample]
    yaw_rate_rad_s = min(max(yaw_rate_rad_s, -w.yaw_rate_rad_s_max), w.yaw_rate_rad_s_max)
    curvature_1_m = min(max(curvature_1_m, -w.curvature_1_m_max), w.curvature_1_m_max)
    wheel_rad = min(max(wheel_rad, -w.wheel_rad_max), w.wheel_rad_max)
    w.measured_heading_rad[sample] = on_wire(heading_rad, w.heading_resolution_rad)
    w.measured_yaw_rate_rad_s[sample] = on_wire(yaw_rate_rad_s, w.yaw_rate_resolution_rad_s)
    w.measured_curvature_1_m[sample] = on_wire(curvature_1_m, w.curvature_resolution_1_m)
    w.wheel_rad[sample] = on_wire(wheel_rad, w.wheel_resolution_rad)
    w.status[sample] = status_of(guard, False)


def _take_arrivals(w: Wire, x: Known, s: Any, r: Any, now_ns: int) -> Known:
    arrivals, errors, echoes, commands, vehicle_sample, vehicle_ns, path_end = x
    params, rings = w.params, w.rings
    while arrivals < len(w.arrival_ns) and w.arrival_ns[arrivals] <= now_ns:
        came_ns, sample = w.arrival_ns[arrivals], w.arrival_sample[arrivals]
        message, counter = w.arrival_message[arrivals], sample % COUNTERS
        if message == _LATERAL_ERROR:
            error_m, heading_rad = r.measured_m[sample], w.measured_heading_rad[sample]
            errors = error_step(
                params, rings, errors, echoes, counter, error_m, heading_rad, came_ns
            )
        elif message == _STEERING_STATUS:
            command = r.command[sample]
            applied = s.command_tick[command] % COMMAND_COUNTERS if command >= 0 else 0
            code, wheel_rad = w.status[sample], w.wheel_rad[sample]
            echoes = echo_step(
                params, rings, echoes, errors, commands, counter, applied, code, wheel_rad, came_ns
            )
        elif message == _VEHICLE_STATE:
            vehicle_sample, vehicle_ns = sample, came_ns
        else:
            speed_m_s = w.speed_m_s if vehicle_sample >= 0 else 0.0
            ahead_1_m = w.path_ahead_1_m[sample // w.samples_per_path]
            path_end = path_step(
                params, rings, path_end, errors, counter, w.path_spacing_m, ahead_1_m, speed_m_s
            )
        arrivals += 1
    return Known(arrivals, errors, echoes, commands, vehicle_sample, vehicle_ns, path_end)


def _take_command(w: Wire, x: Known, tick: int, sent_rad: float, is_planned: bool) -> Known:
    commands = command_step(w.rings, x.commands, tick, sent_rad, is_planned)
    return Known(
        x.arrivals, x.errors, x.echoes, commands, x.vehicle_sample, x.vehicle_ns, x.path_end
    )


def _write_plan(w: Wire, limits: SteerLimits, acting: int, tick: int, before_rad: float) -> None:
    if acting >= 0:
        row = w.rings.plans[tick & (len(w.rings.plans) - 1)]
        limit_plan(limits, w.periods_per_sample, before_rad, acting, row)


def _carries_plan(w: Wire, tick: int) -> bool:
    row = w.rings.plans[tick & (len(w.rings.plans) - 1)]
    if len(w.rings.plans) == 1 or row[1] == 0.0:
        return False
    w.buffer[0], w.buffer[1] = row[0], row[1]
    for index in range(2, ROW_LENGTH):
        w.buffer[index] = on_wire(row[index], w.steer_resolution_rad)
    return True


def _play(w: Wire, sample: int) -> float:
    age, spacing = (sample - int(w.buffer[0])) % COUNTERS, int(w.buffer[1])
    if has_run_out(age, spacing):
        return math.nan
    values_rad: Any = w.buffer[2:]
    return planned_rad(age, spacing, values_rad)


def _record_played(w: Wire, sample: int, steer_rad: float) -> None:
    w.played_rad[sample] = steer_rad


def _note_now(w: Wire, now: Any, x: Known, tick: int, now_ns: int) -> None:
    speed_m_s = yaw_rate_rad_s = curvature_1_m = 0.0
    is_stale = False
    if x.vehicle_sample >= 0:
        speed_m_s = w.speed_m_s
        yaw_rate_rad_s = w.measured_yaw_rate_rad_s[x.vehicle_sample]
        curvature_1_m = w.measured_curvature_1_m[x.vehicle_sample]
        is_stale = now_ns - x.vehicle_ns > w.params.limits.vehicle_state_ns
    loop_delay = loop_delay_at(w.params, x.errors, x.echoes, x.path_end, x.vehicle_ns, tick, now_ns)
    write(now, Now(VehicleReading(speed_m_s, yaw_rate_rad_s, curvature_1_m, is_stale), loop_delay))


record_wire = _choosing(_record)
"""(wire, sample, linear, guard): records the signals of a sample other than the lateral error."""
take_arrivals = _choosing(_take_arrivals)
"""(wire, known, schedule, records, now_ns): returns the knowledge with all arrivals up to now."""
take_command = _choosing(_take_command)
"""(wire, known, tick, sent_rad, is_planned): returns the knowledge with a tick's command."""
write_plan = _choosing(_write_plan)
"""(wire, limits, acting, tick, before_rad): limits the plan of a tick, if there is one."""
carries_plan = _choosing(_carries_plan, without=False)
"""(wire, tick): whether a tick has sent a plan, which the plant's buffer then holds."""
play = _choosing(_play, without=math.nan)
"""(wire, sample): returns what the buffer has for a sample, NaN for nothing [rad]."""
record_played = _choosing(_record_played)
"""(wire, sample, steer_rad): records what a plan lets act at a sample."""
nothing_known = _choosing(lambda _wire: NOTHING_KNOWN)
"""(wire): returns the knowledge at the start."""
wire_history = _choosing(lambda wire: history_of(wire.rings), without=NO_HISTORY)
"""(wire): returns the history that laws read."""
note_now = _choosing(_note_now)
"""(wire, now, known, tick, now_ns): writes what is known at a tick."""
