"""The plant's motion and its path as compiled code reads them: arrays in place of sequences."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import numpy as np

from ...plant_emulator.path.cg_deviation import deviation_behind_m
from ...plant_emulator.path.path import Path, Pose
from ...plant_emulator.path.path_from_settings import build_path
from ...plant_emulator.path.settings import PathSettings
from ...plant_emulator.settings import PlantSettings
from ...plant_emulator.vehicle.car.car_design import car_motion_params
from ...plant_emulator.vehicle.car.car_motion import CarInterval, GripPatch
from ...plant_emulator.vehicle.car.settings import CarSettings
from ...plant_emulator.vehicle.car.speed_control import SpeedLeg
from ...plant_emulator.vehicle.car.steering_input import Failure
from ...plant_emulator.vehicle.disturbance import DisturbanceInterval
from ...plant_emulator.vehicle.motion_parameters import design_motion_arrays
from ...plant_emulator.vehicle.moving_vehicle import AnyMotionParams
from ...plant_emulator.vehicle.settings import (
    ActuatorSettings,
    DisturbanceSettings,
    VehicleSettings,
)
from ...runtime.array_types import FloatArray, IntArray
from ...runtime.settings.plugin import Part
from .compilation import compiled
from .step_functions import register

register(deviation_behind_m)

_MOTIONS_KEPT = 32
"""Motions cached for the next run with the same plant: about 2 MB each."""


def compiled_motion(plant: PlantSettings) -> AnyMotionParams:
    """Return the parameters of ``plant_motion_params``; equal plants share one."""
    inputs = plant.vehicle, plant.car, plant.actuator, plant.path, plant.disturbance
    return _designed(*inputs, plant.steering_failures, plant.parts)


@lru_cache(maxsize=_MOTIONS_KEPT)
def _designed(
    vehicle: VehicleSettings,
    car: CarSettings | None,
    actuator: ActuatorSettings,
    path: PathSettings,
    disturbance: DisturbanceSettings,
    failures: tuple[Failure, ...],
    parts: tuple[Part, ...],
) -> AnyMotionParams:
    road = _road(path, parts)
    if car is not None:
        params: Any = car_motion_params(vehicle, car, actuator, road, disturbance, failures)
        speed = params.speed._replace(legs=_rows(SpeedLeg, params.speed.legs))
        intervals = _rows(CarInterval, params.intervals)
        patches = _rows(GripPatch, params.patches)
        made: AnyMotionParams = params._replace(speed=speed, intervals=intervals, patches=patches)
        return made
    linear = design_motion_arrays(vehicle, actuator, road, disturbance)
    return linear._replace(intervals=_rows(DisturbanceInterval, linear.intervals))


def _rows(kind: Any, records: Sequence[Any]) -> Any:
    """Return records of a NamedTuple as an array that compiled code reads by their names."""
    types = [(name, np.int64 if name == "start_ns" else np.float64) for name in kind._fields]
    return np.array([tuple(record) for record in records], dtype=types)


@lru_cache(maxsize=_MOTIONS_KEPT)
def _road(settings: PathSettings, _parts: tuple[Part, ...]) -> Path:
    path = build_path(settings)
    arrays: dict[str, Any] = {
        name: np.array(getattr(path, name))
        for name in ("start_m", "curvature_1_m", "curvature_slope_1_m2")
    }
    arrays["pose"] = _rows(Pose, path.pose)
    return path._replace(**arrays)


def cg_deviations_m(
    path: Path,
    arc_length_m: FloatArray,
    heading_error_rad: FloatArray,
    lateral_error_m: FloatArray,
    preview_m: float,
) -> FloatArray:
    """Return ``path.cg_deviation.cg_deviation_m`` of every sample, shape (samples,)."""
    places = (*_located(path, arc_length_m), *_located(path, arc_length_m - preview_m))
    deviations_m = np.empty(len(arc_length_m))
    _fill(path, *places, heading_error_rad, lateral_error_m, preview_m, deviations_m)
    return deviations_m


@compiled
def _fill(
    path: Any, pieces: Any, along_m: Any, end_pieces: Any, end_along_m: Any,
    heading_error_rad: Any, lateral_error_m: Any, preview_m: float, deviations_m: Any,
) -> None:  # fmt: skip
    for sample in range(len(deviations_m)):
        deviations_m[sample] = deviation_behind_m(
            path,
            pieces[sample],
            along_m[sample],
            end_pieces[sample],
            end_along_m[sample],
            heading_error_rad[sample],
            lateral_error_m[sample],
            preview_m,
        )


def _located(path: Path, arc_length_m: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return the piece that holds each point, and its distance from the piece's start [m]."""
    if path.closed:
        arc_length_m = arc_length_m - arc_length_m // path.length_m * path.length_m
    start_m = np.asarray(path.start_m)
    pieces = np.maximum(np.searchsorted(start_m, arc_length_m, "right") - 1, 0)
    return pieces, arc_length_m - start_m[pieces]
