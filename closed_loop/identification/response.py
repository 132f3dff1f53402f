"""The response of a car to a drive: yaw rate and lateral acceleration, open loop and compiled.

Inputs are the measured steering and speed, outputs those of ``car_step`` every STEP_S, the plant's
own step; so a car that the plant drove is fitted without an error of integration. The speed is
imposed, and with it the longitudinal forces.

Several cars are lanes of one loop, which a processor advances by vectors: each lane has the bits of
its car alone.
"""

from collections.abc import Mapping, Sequence
from itertools import accumulate, pairwise, repeat
from math import ceil, exp, sqrt
from typing import Any, NamedTuple

import numpy as np
from numba.extending import register_jitable
from scipy.interpolate import make_interp_spline
from scipy.ndimage import uniform_filter1d

from ...plant_emulator.vehicle.car.car_design import car_params
from ...plant_emulator.vehicle.car.car_step import CarInput, CarParams, CarState, car_step
from ...plant_emulator.vehicle.car.tyre import TyreParams
from ...runtime.array_types import FloatArray, IntArray
from ..compiled.compilation import compiled_unchecked
from ..compiled.inlined_functions import INLINE
from ..compiled.memory import on_stack
from ..compiled.step_functions import register, register_steps
from .parameters import Known, car_tables
from .time_series import SETTLING_S, Channel, Drive, Quantity

STEP_S = 0.001
LANES = 16
"""Cars at once: they take as long as five one by one."""
_BLOCK = 32
"""Steps whose steering is read before the first of them, and whose outputs are sensed after."""
_COARSE = 5
_SMOOTHING_S = 0.5
"""Of the speed, for the acceleration."""
DRAWS = 12
_STEADY = 5
"""Samples of the wheel whose mean shows what lies between two steps of its resolution."""
_STEPS_OFF = 2.0
"""A wheel's angle is taken as right within a step to either side, and not half of one; chosen."""


class Grid(NamedTuple):
    """A drive on even steps, its segments one after the other.

    ``judged``      the outputs' samples that are compared with a response
    ``step_s``      STEP_S, or a multiple
    ``starts``      of each segment, and the end of the last, shape (segments + 1,)
    ``first_yaw_rates_rad_s``  of each segment
    ``unresolved``  what its resolution may hide of the steering, shape (draws, steps)
    The others have shape (steps,), the steering as of the ends of the steps.
    """

    judged: tuple[Channel, ...]
    step_s: float
    starts: IntArray
    first_yaw_rates_rad_s: FloatArray
    time_s: FloatArray
    steering_rad: FloatArray
    speed_m_s: FloatArray
    acceleration_m_s2: FloatArray
    unresolved: FloatArray


def grid_of(drive: Drive) -> Grid:
    """Return the inputs of a drive on the grid, and its outputs."""
    drawn, angle = np.random.default_rng(1).uniform(-0.5, 0.5, (2, DRAWS, 1)), drive.steering
    # A wheel at rest keeps its error, another one at each angle; of one that moves it is noise.
    fine = uniform_filter1d(angle.values, _STEADY) / max(angle.quantum, 1e-12)
    fine = fine * (1.0 + 0.05 * drawn[0]) + drawn[1]
    errors = _STEPS_OFF * (np.round(fine) - fine) * angle.quantum
    angles = np.vstack((angle.values, errors))
    parts = []
    for start, end in drive.segments:
        time_s = np.arange(start, end, STEP_S)
        speed = np.interp(time_s, drive.speed.time_s, drive.speed.values)
        smooth = uniform_filter1d(speed, round(_SMOOTHING_S / STEP_S) + 1, mode="nearest")
        near = (angle.time_s > start - 1.0) & (angle.time_s < end + 1.0)
        at_s = angle.time_s[near]
        # Straight lines between samples would be taken for a lag: (ωT)²/12 of the amplitude.
        degree = 3 if np.diff(at_s).min() > 0.3 * angle.period_s else 1
        spline = make_interp_spline(at_s, angles[:, near], degree, axis=1)
        driven = time_s, speed, np.gradient(smooth, STEP_S)
        parts.append(np.vstack((*driven, spline(np.minimum(time_s + STEP_S, at_s[-1])))))
    rows = np.ascontiguousarray(np.concatenate(parts, axis=1))
    time_s, speed, acceleration, steering = rows[:4]
    starts = np.cumsum([0, *(part.shape[1] for part in parts)])
    rate, (begins_s, _) = drive.outputs[0], np.transpose(drive.segments)
    first = np.interp(begins_s, rate.time_s, rate.values)
    inputs = time_s, steering, speed, acceleration, rows[4:]
    judged = tuple(one.within(drive.segments, SETTLING_S) for one in drive.outputs)
    return Grid(judged, STEP_S, starts, first, *inputs)


def coarse(grid: Grid) -> Grid:
    """Return a grid of wider steps, on which a search comes near to the end sooner."""
    step_s, starts = _COARSE * grid.step_s, -(-grid.starts // _COARSE)
    at = np.arange(0, len(grid.time_s), _COARSE)
    wide = Grid(
        grid.judged, step_s, starts, grid.first_yaw_rates_rad_s, *(one[..., at] for one in grid[4:])
    )
    next_starts = grid.starts[np.searchsorted(grid.starts, at, side="right")]
    ends = np.minimum(at + _COARSE, next_starts) - 1
    steering = {"steering_rad": grid.steering_rad[ends], "unresolved": grid.unresolved[..., ends]}
    return wide._replace(**steering)


def respond(
    grid: Grid,
    cars: Sequence[Mapping[str, float]],
    known: Known,
    hidden_rad: FloatArray | None = None,
) -> list[list[FloatArray]]:
    """Return what the sensors show of cars with these parameters, each at its samples.

    ``hidden_rad``  what is added to the steering of each, shape (cars, steps)
    """
    register_steps()
    register(_car_of)
    params = [car_params(*car_tables(values, known)) for values in cars]
    numbers = np.array([*map(_numbers_of, params, cars, repeat(grid.step_s))])
    magic = params[0].front[3:] if known.tyre == "magic_formula" else None
    steered = np.atleast_2d(grid.steering_rad + (0.0 if hidden_rad is None else hidden_rad))
    ahead_1_s = known.lateral_acceleration_ahead_m / grid.step_s
    segments = grid.starts, grid.first_yaw_rates_rad_s
    drive = grid.step_s, ahead_1_s, *segments, grid.time_s, grid.speed_m_s, grid.acceleration_m_s2
    samples_s = np.concatenate([one.time_s for one in grid.judged])
    bounds = [0, *accumulate(len(one.time_s) for one in grid.judged)]
    ends_s = np.append(grid.time_s[grid.starts[1:-1]], np.inf)
    ends = np.array([np.searchsorted(one.time_s, ends_s) for one in grid.judged]).T + bounds[:-1]
    sensors = np.array([[_sensor_of(one, car) for one in grid.judged] for car in cars])
    shown = np.empty((len(cars), len(samples_s)))
    for first in range(0, len(cars), LANES):
        own = shown[first : first + LANES]
        # Two vectors have eight lanes, or more: those without a car repeat the last one.
        lanes = -(-len(own) // 8) * 8 if len(own) > 1 else 1
        at = np.minimum(first + np.arange(LANES), len(cars) - 1)
        rows = np.minimum(at[:lanes], len(steered) - 1)
        done = np.tile(bounds[:-1], (len(own), 1))
        sensed = sensors[first : first + LANES], samples_s, ends, done, own
        _respond(np.take(numbers, at, axis=0).T.ravel(), magic, rows, steered, drive, sensed)
    return [[one[a:b] for a, b in pairwise(bounds)] for one in shown]


def _sensor_of(channel: Channel, values: Mapping[str, float]) -> tuple[float, ...]:
    """Return which output a sensor shows, its delay, gain and offset."""
    name, of_side = channel.name, channel.quantity is not Quantity.YAW_RATE
    offset = values.get(f"{name}:offset", values["yaw_rate_offset_rad_s"])
    delay_s, gain = values.get(f"{name}:delay_s", 0.0), values.get(f"{name}:gain", 1.0)
    return float(of_side), delay_s, gain, offset


def _numbers_of(p: CarParams, values: Mapping[str, float], h_s: float) -> tuple[float, ...]:
    """Return what ``_respond`` needs of a car and its steering."""
    ratio, lag_s = values["steering_ratio"], sqrt(values["lag_squared_s2"])
    dead_steps = (values["delay_and_lag_s"] - lag_s) / h_s
    # Exact for steering that is straight between two steps.
    kept = exp(-h_s / lag_s) if lag_s > 0.0 else 0.0
    newer = 1.0 - lag_s / h_s * (1.0 - kept)
    offset_rad, late = values["steering_offset_rad"] / ratio, ceil(dead_steps)
    steering = late, late - dead_steps, 1.0 / ratio, offset_rad, kept, newer
    return (*p.front[:3], *p.rear[:3], *p[:10], *p[12:], *steering)


def _car_of(c: Any, i: int, shape: float, curvature: float) -> CarParams:
    """Return the car of a lane, with tyres of this Magic Formula, or Fiala's."""
    n = LANES
    front = TyreParams(c[i], c[i + n], c[i + 2 * n], shape, curvature)
    rear = TyreParams(c[i + 3 * n], c[i + 4 * n], c[i + 5 * n], shape, curvature)
    return CarParams(
        c[i + 6 * n], c[i + 7 * n], c[i + 8 * n], c[i + 9 * n], c[i + 10 * n], c[i + 11 * n],
        c[i + 12 * n], c[i + 13 * n], c[i + 14 * n], c[i + 15 * n], front, rear,
        c[i + 16 * n], c[i + 17 * n], c[i + 18 * n], c[i + 19 * n],
    )  # fmt: skip


def _of_lanes() -> Any:
    """Return a number of each lane, on the stack."""


def _of_block() -> Any:
    """Return a number of each lane in the step before a block, and in its own, on the stack."""


on_stack(_of_lanes, LANES)
on_stack(_of_block, (1 + _BLOCK) * LANES)


@register_jitable(**INLINE)
def _sense(sensed: Any, rates: Any, sides: Any, time_s: Any, block: Any) -> None:
    """Show the samples between the step before a block and its last one, as ``np.interp`` does."""
    sensors, samples_s, ends, done, shown = sensed
    segment, h_s, first, start, last, after = block
    for i in range(len(shown)):
        for q in range(sensors.shape[1]):
            delay_s, gain, offset = sensors[i, q, 1], sensors[i, q, 2], sensors[i, q, 3]
            outputs = rates if sensors[i, q, 0] == 0.0 else sides
            row, k = (1 - start) * LANES + i, done[i, q]
            while k < ends[segment, q]:
                at_s, j = max(samples_s[k] - delay_s, time_s[first]), last
                if at_s < time_s[last]:
                    j = min(first + int((at_s - time_s[first]) / h_s), last - 1)
                    j += int(time_s[j + 1] <= at_s) - int(time_s[j] > at_s)
                elif last + 1 < after:
                    break
                value = outputs[row + j * LANES]
                if j < last:
                    slope = (outputs[row + (j + 1) * LANES] - value) / (time_s[j + 1] - time_s[j])
                    value += slope * (at_s - time_s[j])
                shown[i, k] = gain * value + offset
                k += 1
            done[i, q] = k


@compiled_unchecked
def _respond(c: Any, magic: Any, rows: Any, steered: Any, drive: Any, sensed: Any) -> None:
    """Advance all lanes step by step.

    ``c``       what ``_numbers_of`` returns of each lane, shape (numbers * LANES,)
    ``magic``   shape and curvature of all tyres; None for Fiala's
    ``rows``    of ``steered``, shape (lanes,)
    ``sensed``  of each car what ``_sensor_of`` returns, shape (cars, sensors, 4); when sensors
                sample, one after the other; of each segment and sensor the sample after its last;
                of each car and sensor the next one; and what they show, shape (cars, samples)

    LLVM takes the lanes as vectors, because it sees that their arrays cannot overlap: they lie on
    the stack, and the numbers of ``c`` at constant distances. The kind of tyre is known when this
    is compiled; a vector would compute both.
    """
    h_s, ahead_1_s, starts, first_yaw_rates, time_s, speed_m_s, acceleration_m_s2 = drive
    lanes = len(rows)
    shape, curvature = (0.0, 0.0) if magic is None else magic
    late, along, share, offset_rad = 20 * LANES, 21 * LANES, 22 * LANES, 23 * LANES
    kept, newer = 24 * LANES, 25 * LANES
    v, r, front, rear = _of_lanes(), _of_lanes(), _of_lanes(), _of_lanes()
    a_x, front_n, wheel_rad, before_rad = _of_lanes(), _of_lanes(), _of_lanes(), _of_lanes()
    goals_rad, rates, sides = _of_block(), _of_block(), _of_block()
    for segment in range(len(starts) - 1):
        first, after = starts[segment], starts[segment + 1]
        for i in range(lanes):
            r[i] = first_yaw_rates[segment]
            v[i] = front[i] = rear[i] = a_x[i] = front_n[i] = 0.0
            before_rad[i] = steered[rows[i], first] * c[share + i] + c[offset_rad + i]
            wheel_rad[i] = before_rad[i]
        for start in range(first, after, _BLOCK):
            count = min(_BLOCK, after - start)
            for i in range(lanes):
                rates[i], sides[i] = rates[_BLOCK * LANES + i], sides[_BLOCK * LANES + i]
                part, place, row = c[along + i], start - int(c[late + i]), np.uintp(rows[i])
                above = steered[row, np.uintp(min(max(place, first), after - 1))]
                for j in range(count):
                    below = above
                    above = steered[row, np.uintp(min(max(place + j + 1, first), after - 1))]
                    measured = (1.0 - part) * below + part * above
                    goals_rad[j * LANES + i] = measured * c[share + i] + c[offset_rad + i]
            for j in range(count):
                u, driven_m_s2 = speed_m_s[start + j], acceleration_m_s2[start + j]
                for i in range(lanes):
                    k, n, goal_rad = c[kept + i], c[newer + i], goals_rad[j * LANES + i]
                    wheel = k * wheel_rad[i] + n * goal_rad + (1.0 - k - n) * before_rad[i]
                    before_rad[i], wheel_rad[i] = goal_rad, wheel
                    p = _car_of(c, i, shape, curvature)
                    x = CarState(
                        u, v[i], r[i], front[i], rear[i], a_x[i], 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
                    )
                    # Driven for is also what bends take of the speed.
                    bends_m_s2 = front_n[i] * wheel * p.mass_1_kg - v[i] * r[i]
                    inputs = CarInput(wheel, driven_m_s2 + bends_m_s2, 0.0, 0.0, 1.0, 0.0)
                    y = car_step(p, x, inputs, h_s)
                    turned = y.yaw_rate_rad_s - r[i]
                    rates[(1 + j) * LANES + i] = r[i]
                    sides[(1 + j) * LANES + i] = y.lateral_m_s2 + ahead_1_s * turned
                    _, v[i], r[i], front[i], rear[i], a_x[i], _, front_n[i], _, _, _, _ = y
            block = segment, h_s, first, start, start + count - 1, after
            _sense(sensed, rates, sides, time_s, block)
