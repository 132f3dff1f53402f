"""From the rig's settings to the parameters of a motion."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .actuator import ActuatorParams, WheelPhase
from .disturbance import DisturbanceInterval, disturbance_intervals
from .path import Path
from .path_shapes import build_path
from .propagation import TABLE_ROWS, Table, augmented_matrix, table_rows, transition_table
from .rig_settings import ActuatorSettings, DisturbanceSettings, PathSettings, VehicleSettings
from .vehicle import VehicleParams, on_friction


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


def design_motion(
    vehicle: VehicleSettings,
    actuator: ActuatorSettings,
    path: PathSettings,
    disturbance: DisturbanceSettings,
) -> MotionParams:
    """Return the motion's parameters; computes the transition tables (about 20 ms each).

    Raises SettingsError for a bad waypoint file, ValueError for a vehicle that cannot be computed.
    """
    arrays = design_motion_arrays(vehicle, actuator, build_path(path), disturbance)
    table, first_rows = table_rows(np.asarray(arrays.table)), np.asarray(arrays.first_rows).tolist()
    return arrays._replace(table=table, first_rows=first_rows)


def design_motion_arrays(
    vehicle: VehicleSettings,
    actuator: ActuatorSettings,
    path: Path,
    disturbance: DisturbanceSettings,
) -> MotionParams:
    """Return the same on a path that is built, with arrays for ``table`` and ``first_rows``."""
    params = vehicle_params(vehicle)
    actuator_params = ActuatorParams(
        actuator.lag_s,
        math.inf if actuator.angle_limit_rad is None else actuator.angle_limit_rad,
        math.inf if actuator.rate_limit_rad_s is None else actuator.rate_limit_rad_s,
        actuator.dead_band_rad,
    )
    intervals = disturbance_intervals(disturbance, params)
    table: Any
    first_rows: Any
    table, first_rows = transitions(params, actuator_params, intervals)
    return MotionParams(
        params.speed_m_s,
        params.preview_distance_m,
        actuator_params,
        path,
        intervals,
        table,
        first_rows,
    )


def vehicle_params(settings: VehicleSettings) -> VehicleParams:
    """Return the vehicle's parameters."""
    return VehicleParams(
        settings.speed_m_s,
        settings.virtual_mass_kg,
        settings.yaw_inertia_kg_m2,
        settings.front_cornering_stiffness_n_rad,
        settings.rear_cornering_stiffness_n_rad,
        settings.front_axle_distance_m,
        settings.rear_axle_distance_m,
        settings.preview_distance_m,
    )


def transitions(
    vehicle: VehicleParams, actuator: ActuatorParams, intervals: Sequence[DisturbanceInterval]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the tables of every friction and wheel phase, end to end, and `first_rows`."""
    settling_1_s = 1.0 / actuator.lag_s if actuator.lag_s > 0.0 else 0.0
    # A wheel at rest needs no table of its own, nor does a ramp without a rate limit.
    ramping_1_s = 0.0 if actuator.rate_limit_rad_s < math.inf else settling_1_s
    by_phase = {
        WheelPhase.HELD: settling_1_s,
        WheelPhase.RAMPING: ramping_1_s,
        WheelPhase.SETTLING: settling_1_s,
    }
    tables: list[NDArray[np.float64]] = []
    starts: dict[tuple[float, float], int] = {}
    first_rows = []
    for interval in intervals:
        for settling in {settling_1_s, ramping_1_s}:
            if (interval.friction, settling) not in starts:
                starts[interval.friction, settling] = TABLE_ROWS * len(tables)
                on_road = on_friction(vehicle, interval.friction)
                tables.append(transition_table(augmented_matrix(on_road, settling)))
        first_rows.append(tuple(starts[interval.friction, by_phase[phase]] for phase in WheelPhase))
    return np.concatenate(tables), np.array(first_rows, dtype=np.int64)
