"""The sampled loop around one vehicle as matrices, with what drives it: path, forces, noise.

    x = (β, r, Δψ, y, δ; law; u[k], u[k-1], ..., u[k-n]; s; 1)

    plant   over one step of T/steps_per_period, exact: the command held, behind the actuator's lag
            where there is one, a curvature that is a straight line over the step, and
            disturbances held over it
    law     as it steps, from the error measured at each tick
    u       commands, the newest first
    s       a weighted sum of errors (``propagation``)
    1       so that what drives the loop is part of its matrix

Left out are the limits of commands and actuator, and the resolution of signals: a run that meets no
limit is linear. Whatever else is not linear, or not of this form, is rejected.

The moments of this jump-linear loop are moved by one control period in compiled code, in place.
Arrays have the shape (modes, states, columns). A first moment has one column, or several that do
not mix. A second moment has as many columns as states, and is moved in its rows and columns."""

from typing import Any, NamedTuple

import numpy as np

from steer_by_wire.closed_loop.compiled.compilation import compiled
from steer_by_wire.controller.analysis.linear_system import LinearSystem, floats_of, law_system
from steer_by_wire.controller.laws.assembly import design_law
from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.plant_emulator.network.latency_distributions import Distribution
from steer_by_wire.plant_emulator.network.settings import LatencySettings, Order
from steer_by_wire.plant_emulator.path.path import curvature
from steer_by_wire.plant_emulator.path.shapes import build_path
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.plant_emulator.vehicle.disturbance import disturbance_intervals
from steer_by_wire.plant_emulator.vehicle.motion_parameters import vehicle_params
from steer_by_wire.plant_emulator.vehicle.settings import DisturbanceSettings
from steer_by_wire.plant_emulator.vehicle.single_track_model import VehicleParams, state_matrices
from steer_by_wire.runtime.array_types import FloatArray
from steer_by_wire.runtime.node import NS_PER_S
from steer_by_wire.runtime.settings import SettingsError

LATERAL_ERROR, WHEEL = 3, 4
"""Places of y and δ in the plant's state."""


class LinearLoop(NamedTuple):
    """The parts of the loop; ``driven`` has shape (steps, plant states).

    ``law_at_rest``  the law's state after a constant error of 1 m, from which it starts: it takes
                     the first measurement for a lasting one
    ``transition``   of the plant over one step
    ``hold``         what a unit command held over the step adds
    ``driven``       what path and disturbances add in each step
    ``noise_m``      standard deviation of white noise on each measurement
    ``periods``      of the whole run
    """

    law: LinearSystem
    law_at_rest: FloatArray
    transition: FloatArray
    hold: FloatArray
    driven: FloatArray
    noise_m: float
    periods: int
    period_s: float
    steps_per_period: int


def linear_loop(
    plant: PlantSettings, controller: ControllerSettings, steps_per_period: int = 1
) -> LinearLoop:
    """Return the loop of a run; raises SettingsError where it is not of this form."""
    mistakes = _unfit(plant, controller)
    if mistakes:
        raise SettingsError(*mistakes)
    step_s = controller.period_ns / NS_PER_S / steps_per_period
    periods = -(-plant.duration_ns // controller.period_ns)
    params = vehicle_params(plant.vehicle)
    a, b = _plant_matrices(params, plant.actuator.lag_s)
    transition, (hold, at_start, *disturbed), rise = _over_step(a, b, step_s)
    ends_s = step_s * np.arange(periods * steps_per_period + 1, dtype=np.float64)
    path = build_path(plant.path)
    rho_1_m = np.array([curvature(path, s_m) for s_m in (params.speed_m_s * ends_s).tolist()])
    driven = np.outer(rho_1_m[:-1], at_start) + np.outer(np.diff(rho_1_m) / step_s, rise)
    driven += _disturbances(plant.disturbance, params, ends_s) @ np.array(disturbed)
    design = design_law(controller)
    law, at_rest = law_system(design), floats_of(design.initial_state(1.0))
    return LinearLoop(
        law,
        np.array([*at_rest, *[0.0] * (len(law.b) - len(at_rest))]),
        transition,
        hold,
        driven,
        plant.sensor_noise.lateral_error_m,
        periods,
        controller.period_ns / NS_PER_S,
        steps_per_period,
    )


def _plant_matrices(vehicle: VehicleParams, lag_s: float) -> tuple[FloatArray, FloatArray]:
    """Return A, and B of command, curvature, wβ and wr; without a lag the wheel is no state."""
    a, b = state_matrices(vehicle)
    if lag_s == 0.0:
        return a, b
    with_wheel = np.zeros((5, 5))
    with_wheel[:4, :4] = a
    with_wheel[:4, WHEEL] = b[:, 0]
    with_wheel[WHEEL, WHEEL] = -1.0 / lag_s
    inputs = np.zeros((5, 4))
    inputs[WHEEL, 0] = 1.0 / lag_s
    inputs[:4, 1:] = b[:, 1:]
    return with_wheel, inputs


def _over_step(
    a: FloatArray, b: FloatArray, step_s: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return e^(At), what each input held at 1 adds, and a curvature that rises by 1/s."""
    from scipy.linalg import expm

    order, inputs = b.shape
    both = np.zeros((order + inputs + 1, order + inputs + 1))
    both[:order, :order] = a
    both[:order, order:-1] = b
    both[order + 1, -1] = 1.0
    moved = expm(both * step_s)
    return moved[:order, :order], moved[:order, order:-1].T, moved[:order, -1]


def _disturbances(
    settings: DisturbanceSettings, vehicle: VehicleParams, ends_s: FloatArray
) -> FloatArray:
    """Return wβ and wr of each step, shape (steps, 2): the mean, where they jump within it."""
    intervals = disturbance_intervals(settings, vehicle)
    starts_s = np.array([interval.start_ns / NS_PER_S for interval in intervals])
    values = np.array([interval[1:3] for interval in intervals])
    jumps = np.diff(values, axis=0, prepend=np.zeros((1, 2)))
    since_s = np.maximum(ends_s[:, None] - starts_s, 0.0)
    return np.asarray(np.diff(since_s @ jumps, axis=0) / np.diff(ends_s)[:, None])


def _unfit(plant: PlantSettings, controller: ControllerSettings) -> list[str]:
    down, actuator = plant.latency.downlink, plant.actuator
    conditions = {
        "law: must read the lateral error and its own commands alone": design_law(
            controller
        ).commands_read
        is None,
        "feed_forward: must be left out": controller.feed_forward is not None,
        "latency.uplink: must be left out": plant.latency.uplink != LatencySettings(),
        "sensor_period_ms: must be the control period": plant.sensor_period_ns
        != controller.period_ns,
        "actuator.rate_limit_rad_s: must be left out": actuator.rate_limit_rad_s is not None,
        "actuator.dead_band_rad: must be 0": actuator.dead_band_rad > 0.0,
        "disturbance.steps: must not change friction": any(
            step.friction is not None for step in plant.disturbance.all_steps
        ),
        "vehicle.model: must be left out": plant.vehicle.model is not None,
        "latency.downlink.model: must be one of ours": not isinstance(down.model, Distribution),
        "latency.downlink.order: must be newest_wins": down.order is not Order.NEWEST_WINS,
        "latency.downlink.duplicates: must be 0": down.duplicates > 0.0,
        "latency.downlink.burst_frames: must be left out": down.burst_frames is not None,
        "latency.downlink.loss_in_good: must be 0": down.loss_in_good > 0.0,
        "latency.downlink.correlation_time_s: must be 0": down.correlation_time_s > 0.0,
        "latency.downlink.schedule: must be left out": bool(down.schedule),
        "latency.downlink.trace_file: must be left out": down.trace_file is not None,
        "start_on_first_command: must be true": not plant.start_on_first_command,
    }
    return [
        f"{what} for the expected cost, which is of a linear loop and independent latencies"
        for what, is_unfit in conditions.items()
        if is_unfit
    ]


class Recursion(NamedTuple):
    """The matrices of a period.

    ``decision``    (1 + law, law + 1): from y and the law, the law's new states and its command
    ``transition``, ``hold``   of the plant over one step, ``transition`` (from, to)
    ``chosen``, ``kept``       (steps, modes): see ``jitter``
    ``held``        state that holds the command of mode 0, the youngest; each older one is next
    ``plant_end``, ``law_end``   where law and commands begin
    """

    decision: FloatArray
    transition: FloatArray
    hold: FloatArray
    chosen: FloatArray
    kept: FloatArray
    held: int
    plant_end: int
    law_end: int


@compiled
def move_first(r: Any, x: Any, driven: Any) -> None:
    """Move first moments by one period; ``driven`` (steps, plant states) is what drives it."""
    work = np.empty(len(r.decision) + len(r.hold))
    for mode in range(x.shape[0]):
        _decide_rows(r, x[mode], work)
    _age(x)
    for step in range(len(driven)):
        _choose(x, r.chosen[step], r.kept[step])
        for mode in range(x.shape[0]):
            _move_rows(r, x[mode], r.held + mode, driven[step], work)


@compiled
def move_second(r: Any, x: Any, driven: Any, noise: Any) -> None:
    """Move second moments by one period; ``noise`` is what the noise adds as the law decides."""
    work = np.empty(len(r.decision) + len(r.hold))
    one = x.shape[1] - 1
    for mode in range(x.shape[0]):
        _decide_rows(r, x[mode], work)
        _decide_rows(r, x[mode].T, work)
        probability = x[mode, one, one]
        for i in range(r.plant_end, r.law_end + 1):
            for j in range(r.plant_end, r.law_end + 1):
                x[mode, i, j] += probability * noise[i] * noise[j]
    _age(x)
    for step in range(len(driven)):
        _choose(x, r.chosen[step], r.kept[step])
        for mode in range(x.shape[0]):
            _move_rows(r, x[mode], r.held + mode, driven[step], work)
            _move_rows(r, x[mode].T, r.held + mode, driven[step], work)


@compiled
def _decide_rows(r: Any, x: Any, work: Any) -> None:
    """Apply the law's decision: its command comes first, all others get one period older."""
    start, end, last = r.plant_end, r.law_end, x.shape[0] - 3
    for i in range(last, end, -1):
        x[i] = x[i - 1]
    for column in range(x.shape[1]):
        for i in range(end - start + 1):
            work[i] = r.decision[0, i] * x[3, column]
        for j in range(end - start):
            for i in range(end - start + 1):
                work[i] += r.decision[1 + j, i] * x[start + j, column]
        for i in range(end - start + 1):
            x[start + i, column] = work[i]


@compiled
def _move_rows(r: Any, x: Any, held: Any, driven: Any, work: Any) -> None:
    """Move the plant by one step, the command of state ``held`` acting."""
    order, one = len(r.hold), x.shape[0] - 1
    for column in range(x.shape[1]):
        for i in range(order):
            work[i] = r.hold[i] * x[held, column] + driven[i] * x[one, column]
        for j in range(order):
            for i in range(order):
                work[i] += r.transition[j, i] * x[j, column]
        for i in range(order):
            x[i, column] = work[i]


@compiled
def _age(x: Any) -> None:
    """Make every command a period older; the oldest mode keeps its moments."""
    last = x.shape[0] - 1
    if last == 0:
        return
    x[last] += x[last - 1]
    for mode in range(last - 1, 0, -1):
        x[mode] = x[mode - 1]
    x[0] = 0.0


@compiled
def _choose(x: Any, chosen: Any, kept: Any) -> None:
    """Let commands arrive: a younger one replaces any older one."""
    older = np.zeros(x.shape[1:])
    for mode in range(x.shape[0] - 1, -1, -1):
        for i in range(x.shape[1]):
            for j in range(x.shape[2]):
                value = x[mode, i, j]
                x[mode, i, j] = kept[mode] * value + chosen[mode] * older[i, j]
                older[i, j] += value
