"""The motion of the plant emulator in the form that compiles: arrays in place of lists.

With the deviation of the centre of gravity at every sample of a run.
"""

from functools import lru_cache
from typing import Any

import numpy as np

from ...plant_emulator.path.cg_deviation import deviation_behind_m
from ...plant_emulator.path.path import Path, Pose
from ...plant_emulator.path.settings import PathSettings
from ...plant_emulator.path.shapes import build_path
from ...plant_emulator.settings import PlantSettings
from ...plant_emulator.vehicle.disturbance import DisturbanceInterval
from ...plant_emulator.vehicle.motion_parameters import MotionParams, design_motion_arrays
from ...plant_emulator.vehicle.settings import (
    ActuatorSettings,
    DisturbanceSettings,
    VehicleSettings,
)
from .compilation import compiled

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


@compiled
def cg_deviations_m(
    path: Any, arc_length_m: Any, heading_error_rad: Any, lateral_error_m: Any, preview_m: float
) -> Any:
    """Return ``path.cg_deviation.cg_deviation_m`` of every sample, shape (samples,)."""
    deviations_m = np.empty(len(arc_length_m))
    for sample in range(len(arc_length_m)):
        piece, along_m = _located(path, arc_length_m[sample])
        end_piece, end_along_m = _located(path, arc_length_m[sample] - preview_m)
        deviations_m[sample] = deviation_behind_m(
            path,
            piece,
            along_m,
            end_piece,
            end_along_m,
            heading_error_rad[sample],
            lateral_error_m[sample],
            preview_m,
        )
    return deviations_m


@compiled
def _located(path: Any, arc_length_m: Any) -> Any:
    """Return the piece that holds a point, and the point's distance from the piece's start [m]."""
    lap = arc_length_m // path.length_m if path.closed else 0.0
    in_lap_m = arc_length_m - lap * path.length_m
    piece = max(np.searchsorted(path.start_m, in_lap_m, "right") - 1, 0)
    return piece, in_lap_m - path.start_m[piece]
