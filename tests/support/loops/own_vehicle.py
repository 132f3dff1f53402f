"""The vehicle of the tests, and their own derivation of how it moves in one period."""

from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from steer_by_wire.controller.filters.settings import VehicleModelSettings

PERIOD_S = 0.01
VEHICLE = VehicleModelSettings(
    kind="vehicle",
    virtual_mass_kg=2000.0,
    yaw_inertia_kg_m2=3728.0,
    front_cornering_stiffness_n_rad=190e3,
    rear_cornering_stiffness_n_rad=500e3,
    front_axle_distance_m=1.3008,
    rear_axle_distance_m=1.5453,
    preview_distance_m=2.0,
    speed_m_s=5.0 / 3.6,
)


@cache
def transition(
    speed_km_h: float, mass_kg: float, c_f: float = 190e3, l_s: float = 2.0
) -> NDArray[np.float64]:
    """Return the (4, 6) map from (β, r, Δψ, y, steer, curvature) to the state a period later."""
    v, j, c_r, l_f, l_r = speed_km_h / 3.6, 3728.0, 500e3, 1.3008, 1.5453
    lever = c_r * l_r - c_f * l_f
    m = np.zeros((6, 6))
    m[0] = -(c_r + c_f) / (mass_kg * v), -1 + lever / (mass_kg * v**2), 0, 0, c_f / (mass_kg * v), 0
    m[1] = lever / j, -(c_r * l_r**2 + c_f * l_f**2) / (j * v), 0, 0, c_f * l_f / j, 0
    m[2] = 0, 1, 0, 0, 0, -v
    m[3] = v, l_s, v, 0, 0, 0
    return np.array(expm(m * PERIOD_S)[:4], dtype=np.float64)
