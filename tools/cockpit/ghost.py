"""The ghost: the car as the hand would move it if no network delayed the hand.

z' = A z + B (δ − δₐ) − z/τ       y_ghost = y + z_y

A, B  of the plant's single-track model (1)
δ     the newest command on the bus      [rad]
δₐ    the command that the plant applies [rad]
τ     5 s                                not in paper: forgets, or the two would part for good
"""

import math
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from ...plant_emulator.vehicle.motion_parameters import vehicle_params
from ...plant_emulator.vehicle.settings import VehicleSettings
from ...plant_emulator.vehicle.single_track_model import state_matrices
from .signals import ROW_PERIOD_S

_FORGETS_S = 5.0
_SIZE = 4
_HEADING, _LATERAL = 2, 3


class Offset(NamedTuple):
    """Where the ghost is against the car: to its left, and turned to the left."""

    lateral_m: float
    heading_rad: float


class Ghost:
    """Advances by one row at a time."""

    def __init__(self, vehicle: VehicleSettings) -> None:
        a, b = state_matrices(vehicle_params(vehicle))
        system = np.zeros((_SIZE + 1, _SIZE + 1))
        system[:_SIZE, :_SIZE] = a - np.eye(_SIZE) / _FORGETS_S
        system[:_SIZE, _SIZE] = b[:, 0]
        step = expm(ROW_PERIOD_S * system)
        self._keep, self._gain = step[:_SIZE, :_SIZE], step[:_SIZE, _SIZE]
        self._state = np.zeros(_SIZE)

    def step(self, steer_rad: float, in_effect_rad: float) -> Offset:
        """Advance by the time between two rows; unknown angles count as equal."""
        ahead_rad = steer_rad - in_effect_rad
        ahead_rad = ahead_rad if math.isfinite(ahead_rad) else 0.0
        self._state = self._keep @ self._state + self._gain * ahead_rad
        return Offset(float(self._state[_LATERAL]), float(self._state[_HEADING]))
