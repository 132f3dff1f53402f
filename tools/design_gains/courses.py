"""The runs of a specification as the vehicle feels them: curvature over time at its speed."""

from functools import lru_cache

import numpy as np

from ...loop_theory.tracking import unsteered_error_m
from ...plant_emulator.path import Path, curvature
from ...plant_emulator.path_shapes import build_path
from ...runtime.array_types import FloatArray
from ...runtime.node import NS_PER_S
from .specification import Specification
from .vehicle_file import VehicleFile

_SAMPLES_PER_TICK = 4
"""Between two, curvature is taken as linear, which is exact except at the path's break points."""


def unsteered_runs_m(spec: Specification, vehicle: VehicleFile) -> FloatArray:
    """Return the lateral error without steering at the ticks, shape (paths, corners, ticks) [m]."""
    ticks = spec.ticks
    speeds_m_s = [corner.speed_m_s for corner in vehicle.box.vertices()]
    paths = [build_path(path) for path in spec.course.paths]
    interval_s = spec.period_ns / NS_PER_S / _SAMPLES_PER_TICK

    @lru_cache
    def unsteered(path_index: int, speed_m_s: float) -> FloatArray:
        met = _curvature_met(paths[path_index], speed_m_s, interval_s, ticks)
        return unsteered_error_m(met, interval_s, speed_m_s, _SAMPLES_PER_TICK)

    return np.array([[unsteered(i, v) for v in speeds_m_s] for i in range(len(paths))])


def _curvature_met(path: Path, speed_m_s: float, interval_s: float, ticks: int) -> FloatArray:
    count = (ticks - 1) * _SAMPLES_PER_TICK + 1
    return np.array([curvature(path, speed_m_s * interval_s * index) for index in range(count)])
