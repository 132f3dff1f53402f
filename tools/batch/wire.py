"""What a law that looks back is told in a compiled run, tick by tick, besides the newest error.

Most laws read the newest error and their last command only: their runs carry ``NoWire``, which
records nothing and costs nothing. A law that looks back gets a ``Wire``: which sample of each
message is the newest at each tick and which command was in effect at each sample are known before
(``tools.batch.wire_plan``); the measurements themselves are recorded as they are taken.

The two functions here choose by the type of the wire when they are compiled.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numba.extending import overload
from numpy.typing import NDArray

from controller.law_interface import History, LawInput, Link, VehicleReading
from plant_emulator.propagation import LinearState
from plant_emulator.steering_guard import GuardState, is_overruled
from tools.batch.borrowing import borrowed
from tools.batch.compilation import compiled_inline, compiled_inside


class NoWire(NamedTuple):
    """Stands for a wire that nobody looks at."""

    unused: int


class Wire(NamedTuple):
    """Arrays of shape (ticks,), then of shape (samples,), then numbers.

    ``*_sample``        the newest sample at each tick, -1 for none, of each message
    ``is_vehicle_stale``  whether the newest VEHICLE_STATE is too old at each tick, 0 or 1
    ``is_measured``     whether the delay and the speed are known at each tick, 0 or 1
    ``has_error``       whether a sample's LATERAL_ERROR came, 0 or 1
    ``has_echo``        whether a sample's STEERING_STATUS came, 0 or 1
    ``applied_tick``    the tick whose command each sample's echo names, -1 for none
    ``is_overruled``    whether a sample's echo says that the wheel's target is another, 0 or 1; and
    ``wheel_rad``       where it says the wheel is; written while the run goes on
    ``measured_*``      as on the wire; written while the run goes on
    ``*_resolution_*``  of the signals, and the ranges they are clamped to
    """

    error_sample: NDArray[np.int64]
    echo_sample: NDArray[np.int64]
    vehicle_sample: NDArray[np.int64]
    is_vehicle_stale: NDArray[np.int64]
    delay_ns: NDArray[np.float64]
    is_measured: NDArray[np.int64]
    has_error: NDArray[np.int64]
    has_echo: NDArray[np.int64]
    applied_tick: NDArray[np.int64]
    heading_noise_rad: NDArray[np.float64]
    yaw_rate_noise_rad_s: NDArray[np.float64]
    measured_heading_rad: NDArray[np.float64]
    measured_yaw_rate_rad_s: NDArray[np.float64]
    measured_curvature_1_m: NDArray[np.float64]
    is_overruled: NDArray[np.int64]
    wheel_rad: NDArray[np.float64]
    speed_m_s: float
    heading_resolution_rad: float
    yaw_rate_resolution_rad_s: float
    yaw_rate_rad_s_max: float
    curvature_resolution_1_m: float
    curvature_1_m_max: float
    wheel_resolution_rad: float
    wheel_rad_max: float


NO_WIRE = NoWire(0)


@compiled_inline
def on_wire(value: float, resolution: float) -> float:
    """Return what a signal makes of a value: ``round(value / resolution) * resolution``.

    Rounded as a float, because the way through an integer costs more than the law; 0.0 is added
    because rounding gives a negative zero where an integer has none.
    """
    return float((np.rint(value / resolution) + 0.0) * resolution)


def borrowed_wire(wire: Any) -> Any:
    """Return the wire with borrowed arrays."""
    raise NotImplementedError("for compiled code")


def record_wire(wire: Any, sample: int, z: LinearState, guard: GuardState) -> None:
    """Keep what the sensors report of a sample besides its lateral error."""
    raise NotImplementedError("for compiled code")


def law_input(
    wire: Any, sent_rad: Any, measured_m: Any, tick: int, error_m: float, last_sent_rad: float
) -> LawInput:
    """Return what the law is told at a tick."""
    raise NotImplementedError("for compiled code")


@compiled_inside
def _borrowed(w: Wire) -> Wire:
    return Wire(
        borrowed(w.error_sample),
        borrowed(w.echo_sample),
        borrowed(w.vehicle_sample),
        borrowed(w.is_vehicle_stale),
        borrowed(w.delay_ns),
        borrowed(w.is_measured),
        borrowed(w.has_error),
        borrowed(w.has_echo),
        borrowed(w.applied_tick),
        borrowed(w.heading_noise_rad),
        borrowed(w.yaw_rate_noise_rad_s),
        borrowed(w.measured_heading_rad),
        borrowed(w.measured_yaw_rate_rad_s),
        borrowed(w.measured_curvature_1_m),
        borrowed(w.is_overruled),
        borrowed(w.wheel_rad),
        w.speed_m_s,
        w.heading_resolution_rad,
        w.yaw_rate_resolution_rad_s,
        w.yaw_rate_rad_s_max,
        w.curvature_resolution_1_m,
        w.curvature_1_m_max,
        w.wheel_resolution_rad,
        w.wheel_rad_max,
    )


@compiled_inside
def _in_one_turn(angle_rad: float) -> float:
    """Return ``math.remainder(angle_rad, math.tau)``, which does not compile; all here is exact."""
    rest_rad = float(np.fmod(angle_rad, math.tau))
    if rest_rad > math.pi:
        return rest_rad - math.tau
    if rest_rad < -math.pi:
        return rest_rad + math.tau
    return rest_rad


@compiled_inside
def _record(w: Wire, sample: int, z: LinearState, guard: GuardState) -> None:
    heading_rad = _in_one_turn(z.heading_error_rad + w.heading_noise_rad[sample])
    yaw_rate_rad_s = z.yaw_rate_rad_s + w.yaw_rate_noise_rad_s[sample]
    yaw_rate_rad_s = min(max(yaw_rate_rad_s, -w.yaw_rate_rad_s_max), w.yaw_rate_rad_s_max)
    curvature_1_m = min(max(z.curvature_1_m, -w.curvature_1_m_max), w.curvature_1_m_max)
    w.measured_heading_rad[sample] = on_wire(heading_rad, w.heading_resolution_rad)
    w.measured_yaw_rate_rad_s[sample] = on_wire(yaw_rate_rad_s, w.yaw_rate_resolution_rad_s)
    w.measured_curvature_1_m[sample] = on_wire(curvature_1_m, w.curvature_resolution_1_m)
    if w.has_echo[sample]:
        wheel_rad = min(max(z.wheel_rad, -w.wheel_rad_max), w.wheel_rad_max)
        w.is_overruled[sample] = is_overruled(guard)
        w.wheel_rad[sample] = on_wire(wheel_rad, w.wheel_resolution_rad)
    elif sample > 0:  # taken for what the last echo said
        w.is_overruled[sample] = w.is_overruled[sample - 1]
        w.wheel_rad[sample] = w.wheel_rad[sample - 1]
    else:
        w.is_overruled[sample], w.wheel_rad[sample] = 0, 0.0


@compiled_inside
def _seen(
    w: Any, sent_rad: Any, measured_m: Any, tick: int, error_m: float, last_sent_rad: float
) -> LawInput:
    vehicle = w.vehicle_sample[tick]
    speed_m_s = yaw_rate_rad_s = curvature_1_m = 0.0
    if vehicle >= 0:
        speed_m_s = w.speed_m_s
        yaw_rate_rad_s = w.measured_yaw_rate_rad_s[vehicle]
        curvature_1_m = w.measured_curvature_1_m[vehicle]
    return LawInput(
        error_m,
        last_sent_rad,
        VehicleReading(speed_m_s, yaw_rate_rad_s, curvature_1_m, w.is_vehicle_stale[tick] != 0),
        Link(
            tick,
            w.error_sample[tick],
            w.echo_sample[tick],
            w.delay_ns[tick],
            w.is_measured[tick] != 0,
        ),
        History(
            -1,
            -1,
            sent_rad,
            measured_m,
            w.measured_heading_rad,
            w.has_error,
            w.applied_tick,
            w.is_overruled,
            w.wheel_rad,
        ),
    )


@overload(borrowed_wire)
def _borrowed_of_type(wire: Any) -> Any:
    if wire.instance_class is NoWire:

        def as_it_is(wire: Any) -> Any:
            return wire

        return as_it_is

    def uncounted(wire: Any) -> Any:
        return _borrowed(wire)

    return uncounted


@overload(record_wire)
def _record_of_type(wire: Any, sample: Any, z: Any, guard: Any) -> Any:  # noqa: ARG001
    if wire.instance_class is NoWire:

        def nothing(wire: Any, sample: Any, z: Any, guard: Any) -> Any:  # noqa: ARG001
            return None

        return nothing

    def recorded(wire: Any, sample: Any, z: Any, guard: Any) -> Any:
        return _record(wire, sample, z, guard)

    return recorded


@overload(law_input)
def _law_input_of_type(
    wire: Any,
    sent_rad: Any,  # noqa: ARG001
    measured_m: Any,  # noqa: ARG001
    tick: Any,  # noqa: ARG001
    error_m: Any,  # noqa: ARG001
    last_sent_rad: Any,  # noqa: ARG001
) -> Any:
    if wire.instance_class is NoWire:

        def newest_only(
            wire: Any,  # noqa: ARG001
            sent_rad: Any,
            measured_m: Any,
            tick: Any,
            error_m: Any,
            last_sent_rad: Any,
        ) -> Any:
            return LawInput(
                error_m,
                last_sent_rad,
                VehicleReading(0.0, 0.0, 0.0, False),
                Link(tick, -1, -1, 0.0, False),
                History(
                    -1, -1, sent_rad, measured_m, measured_m, (False,), (-1,), (False,), (0.0,)
                ),
            )

        return newest_only

    def all_of_it(
        wire: Any, sent_rad: Any, measured_m: Any, tick: Any, error_m: Any, last_sent_rad: Any
    ) -> Any:
        return _seen(wire, sent_rad, measured_m, tick, error_m, last_sent_rad)

    return all_of_it
