"""The motion of the plant emulator in the form that compiles: arrays in place of lists."""

from functools import lru_cache
from typing import Any

import numpy as np

from ..plant_emulator.disturbance import DisturbanceInterval
from ..plant_emulator.motion_design import MotionParams, design_motion_arrays
from ..plant_emulator.path import Path, Pose
from ..plant_emulator.path_shapes import build_path
from ..plant_emulator.rig_settings import (
    ActuatorSettings,
    DisturbanceSettings,
    PathSettings,
    VehicleSettings,
)
from ..plant_emulator.settings import PlantSettings

_KEPT = 32
"""Motions cached for the next run with the same rig: about 2 MB each."""
_INTERVAL = np.dtype(
    [("start_ns", np.int64), *((name, np.float64) for name in DisturbanceInterval._fields[1:])]
)
_POSE = np.dtype([(name, np.float64) for name in Pose._fields])


def compiled_motion(plant: PlantSettings) -> MotionParams:
    """Return the parameters of ``motion_params``; equal rigs share one."""
    return _designed(plant.vehicle, plant.actuator, plant.path, plant.disturbance)


@lru_cache(maxsize=_KEPT)
def _designed(
    vehicle: VehicleSettings,
    actuator: ActuatorSettings,
    path: PathSettings,
    disturbance: DisturbanceSettings,
) -> MotionParams:
    params = design_motion_arrays(vehicle, actuator, _road(path), disturbance)
    intervals = np.array([tuple(interval) for interval in params.intervals], dtype=_INTERVAL)
    arrays: dict[str, Any] = {"intervals": intervals}
    return params._replace(**arrays)


@lru_cache(maxsize=_KEPT)
def _road(settings: PathSettings) -> Path:
    path = build_path(settings)
    arrays: dict[str, Any] = {
        name: np.array(getattr(path, name))
        for name in ("start_m", "curvature_1_m", "curvature_slope_1_m2")
    }
    arrays["pose"] = np.array([tuple(pose) for pose in path.pose], dtype=_POSE)
    return path._replace(**arrays)
