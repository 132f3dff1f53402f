"""Constants of a motion, from the settings tables, transition tables included."""

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from ..path.path import Path
from ..path.path_from_settings import build_path
from ..path.settings import PathSettings
from .actuator import ActuatorParams, WheelPhase
from .car.car_design import car_motion_params
from .car.car_motion import CarMotionParams
from .car.settings import CarSettings
from .car.steering_input import Failure
from .disturbance import DisturbanceInterval, disturbance_intervals
from .exact_propagation import (
    TABLE_ROWS,
    Row,
    Table,
    augmented_matrix,
    table_rows,
    transition_table,
)
from .settings import ActuatorSettings, DisturbanceSettings, VehicleSettings
from .single_track_model import VehicleParams, on_friction

_KEPT = 4
"""Transition tables cached for the next run with the same vehicle: about 10 MB each."""


class MotionParams(NamedTuple):
    """Constants of a motion."""

    speed_m_s: float
    preview_distance_m: float
    actuator: ActuatorParams
    path: Path
    intervals: Sequence[DisturbanceInterval]
    table: Table
    first_rows: Sequence[Sequence[int]]
    """Where in ``table`` each interval's transitions start, by `WheelPhase`."""
    lateral_error_m: float
    """At the start, as the heading error."""
    heading_error_rad: float
    dead_time_ns: int
    """Of the actuator."""


def motion_params(
    vehicle: VehicleSettings,
    actuator: ActuatorSettings,
    path: PathSettings,
    disturbance: DisturbanceSettings,
    car: CarSettings | None = None,
    failures: Sequence[Failure] = (),
) -> MotionParams | CarMotionParams:
    """Design the motion of a run: of ``car``, or linear, with transition tables (40 ms each).

    Raises SettingsError for a bad waypoint file, ValueError for a vehicle that cannot be computed.
    """
    if car is not None:
        return car_motion_params(vehicle, car, actuator, build_path(path), disturbance, failures)
    params = _params(vehicle, actuator, build_path(path), disturbance)
    table, first_rows = transitions(vehicle_params(vehicle), params.actuator, params.intervals)
    return params._replace(table=table, first_rows=first_rows)


def design_motion_arrays(
    vehicle: VehicleSettings,
    actuator: ActuatorSettings,
    path: Path,
    disturbance: DisturbanceSettings,
) -> MotionParams:
    """Return the parameters on a path that is built; ``table``, ``first_rows`` are arrays."""
    params = _params(vehicle, actuator, path, disturbance)
    needed, rows = _needed(vehicle_params(vehicle), params.actuator, params.intervals)
    table: Any = np.concatenate([transition_table(augmented_matrix(*one)) for one in needed])
    first_rows: Any = np.array(rows, dtype=np.int64)
    return params._replace(table=table, first_rows=first_rows)


def _params(
    vehicle: VehicleSettings,
    actuator: ActuatorSettings,
    path: Path,
    disturbance: DisturbanceSettings,
) -> MotionParams:
    """Return the parameters without tables."""
    params = vehicle_params(vehicle)
    servo = ActuatorParams(
        actuator.lag_s,
        math.inf if actuator.angle_limit_rad is None else actuator.angle_limit_rad,
        math.inf if actuator.rate_limit_rad_s is None else actuator.rate_limit_rad_s,
        actuator.dead_band_rad,
    )
    intervals = disturbance_intervals(disturbance, params)
    speed_m_s, preview_m = params.speed_m_s, params.preview_distance_m
    start = vehicle.initial_lateral_error_m, vehicle.initial_heading_error_rad
    driven = speed_m_s, preview_m, servo, path, intervals
    return MotionParams(*driven, (), (), *start, actuator.dead_time_ns)


def vehicle_params(settings: VehicleSettings) -> VehicleParams:
    """Return the vehicle's parameters."""
    return VehicleParams(*(getattr(settings, name) for name in VehicleParams._fields))


def transitions(
    vehicle: VehicleParams, actuator: ActuatorParams, intervals: Sequence[DisturbanceInterval]
) -> tuple[list[Row], list[tuple[int, ...]]]:
    """Return the tables of every friction and wheel phase, end to end, and `first_rows`."""
    needed, first_rows = _needed(vehicle, actuator, intervals)
    return [row for one in needed for row in _rows(*one)], first_rows


@lru_cache(maxsize=_KEPT)
def _rows(vehicle: VehicleParams, settling_1_s: float) -> Sequence[Row]:
    return tuple(table_rows(transition_table(augmented_matrix(vehicle, settling_1_s))))


def _needed(
    vehicle: VehicleParams, actuator: ActuatorParams, intervals: Sequence[DisturbanceInterval]
) -> tuple[list[tuple[VehicleParams, float]], list[tuple[int, ...]]]:
    """Return the arguments of each table needed, and `first_rows` of the tables end to end."""
    settling_1_s = 1.0 / actuator.lag_s if actuator.lag_s > 0.0 else 0.0
    # A wheel at rest needs no table of its own, nor does a ramp without a rate limit.
    ramping_1_s = 0.0 if actuator.rate_limit_rad_s < math.inf else settling_1_s
    by_phase = {
        WheelPhase.HELD: settling_1_s,
        WheelPhase.RAMPING: ramping_1_s,
        WheelPhase.SETTLING: settling_1_s,
    }
    needed: list[tuple[VehicleParams, float]] = []
    starts: dict[tuple[float, float], int] = {}
    first_rows = []
    for interval in intervals:
        for settling in {settling_1_s, ramping_1_s}:
            if (interval.friction, settling) not in starts:
                starts[interval.friction, settling] = TABLE_ROWS * len(needed)
                needed.append((on_friction(vehicle, interval.friction), settling))
        first_rows.append(tuple(starts[interval.friction, by_phase[phase]] for phase in WheelPhase))
    return needed, first_rows
