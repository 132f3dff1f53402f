"""The response of a car to a drive: yaw rate and lateral acceleration, open loop and compiled.

Inputs are the measured steering and speed, outputs those of ``car_step`` every STEP_S, the plant's
own step; so a car that the plant drove is fitted without an error of integration. The speed is
imposed, and with it the longitudinal forces.
"""

from collections.abc import Mapping
from math import exp, sqrt
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.ndimage import uniform_filter1d

from ...plant_emulator.vehicle.car.car_design import car_params
from ...plant_emulator.vehicle.car.car_step import CarInput, CarState, car_step
from ...runtime.array_types import FloatArray, IntArray
from ..compiled.compilation import compiled
from ..compiled.step_functions import register_steps
from .parameters import Known, car_tables
from .time_series import Channel, Drive, Quantity

STEP_S = 0.001
_COARSE = 5
SETTLING_S = 1.0
"""At the start of a segment, not judged: the car's state there is not known."""
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
    inputs = (one[..., ::_COARSE].copy() for one in grid[4:])
    return Grid(grid.judged, step_s, starts, grid.first_yaw_rates_rad_s, *inputs)


class Response(NamedTuple):
    """Outputs of the car on a grid."""

    time_s: FloatArray
    yaw_rate_rad_s: FloatArray
    lateral_acceleration_m_s2: FloatArray


def respond(grid: Grid, values: Mapping[str, float], known: Known) -> Response:
    """Return what a car with these parameters does on a drive."""
    register_steps()
    response = Response(grid.time_s, *np.empty((2, len(grid.time_s))))
    lag_s = sqrt(values["lag_squared_s2"])
    steering = (
        1.0 / values["steering_ratio"],
        values["steering_offset_rad"] / values["steering_ratio"],
        lag_s,
        (values["delay_and_lag_s"] - lag_s) / grid.step_s,
        known.lateral_acceleration_ahead_m,
    )
    driven = grid.steering_rad, grid.speed_m_s, grid.acceleration_m_s2
    segments = grid.starts, grid.first_yaw_rates_rad_s
    params = car_params(*car_tables(values, known))
    _respond(params, steering, grid.step_s, *segments, *driven, *response[1:])
    return response


def seen(channel: Channel, response: Response, values: Mapping[str, float]) -> FloatArray:
    """Return what a sensor shows of a response, at its samples."""
    name, of_rate = channel.name, channel.quantity is Quantity.YAW_RATE
    series = response.yaw_rate_rad_s if of_rate else response.lateral_acceleration_m_s2
    sensed_s = channel.time_s - values.get(f"{name}:delay_s", 0.0)
    offset = values.get(f"{name}:offset", values["yaw_rate_offset_rad_s"])
    shown = np.interp(sensed_s, response.time_s, series)
    return values.get(f"{name}:gain", 1.0) * shown + offset


@compiled
def _respond(
    p: Any,
    steering: Any,
    h_s: float,
    starts: Any,
    first_yaw_rates: Any,
    steer_rad: Any,
    speed_m_s: Any,
    acceleration_m_s2: Any,
    yaw_rates: Any,
    accelerations: Any,
) -> None:
    share, offset_rad, lag_s, dead_steps, ahead_m = steering
    # Exact for steering that is straight between two steps.
    kept = exp(-h_s / lag_s) if lag_s > 0.0 else 0.0
    newer = 1.0 - lag_s / h_s * (1.0 - kept)
    for segment in range(len(starts) - 1):
        first, after = starts[segment], starts[segment + 1]
        r = first_yaw_rates[segment]
        x = CarState(speed_m_s[first], 0.0, r, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        before_rad = wheel_rad = steer_rad[first] * share + offset_rad
        for step in range(first, after):
            place = min(max(step - dead_steps, first), after - 1.0)
            below = min(int(place), after - 2)
            along = place - below
            measured = (1.0 - along) * steer_rad[below] + along * steer_rad[below + 1]
            goal_rad = measured * share + offset_rad
            wheel_rad = kept * wheel_rad + newer * goal_rad + (1.0 - kept - newer) * before_rad
            before_rad = goal_rad
            # Driven for is also what bends take of the speed.
            bends_m_s2 = x.front_lateral_n * wheel_rad * p.mass_1_kg - x.lateral_speed_m_s * r
            demand_m_s2 = acceleration_m_s2[step] + bends_m_s2
            inputs = CarInput(wheel_rad, demand_m_s2, 0.0, 0.0, 1.0, 0.0)
            _, v, r, front, rear, a_x, a_y, force, use, _, _, _ = car_step(p, x, inputs, h_s)
            yaw_rates[step] = x.yaw_rate_rad_s
            accelerations[step] = a_y + ahead_m * (r - x.yaw_rate_rad_s) / h_s
            driven = speed_m_s[min(step + 1, after - 1)]
            x = CarState(driven, v, r, front, rear, a_x, a_y, force, use, 0.0, 0.0, 0.0)
