"""Hand wheel with its feedback motor, and the arms that hold it, as a linear system.

    (J + J_a) θ'' + (b + b_a) θ' + k_a θ = -T          T' = (T_cmd - T)/T_m

    θ      angle of the hand wheel, positive to the left    [rad]
    T      torque of the feedback motor against it          [N m]
    J, b   inertia and damping of the wheel                 [kg m²], [N m s/rad]
    J_a, b_a, k_a   inertia, damping and stiffness of the driver's arms
    T_m    lag of the motor                                 [s]

A torque sensor of stiffness k_s that gives way parts the wheel: above it the rim, with a share of J
and with the arms, below it the rest with the motor, and θ is the angle there.

    J_r θ_r'' = -k_a θ_r - b_a θ_r' - k_s (θ_r - θ)    J_c θ'' = -b θ' - T + k_s (θ_r - θ)

No impedance of arms at a steering wheel was found published. The four grips are chosen.
"""

from collections.abc import Mapping
from math import exp
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from ..runtime.settings import Settings

Matrix = NDArray[np.float64]
Row = tuple[float, float, float]
Rows = tuple[Row, Row, Row]


class LinearSystem(NamedTuple):
    """x' = A x + b u, y = c x; shapes (n, n), (n,), (n,)."""

    a: Matrix
    b: Matrix
    c: Matrix


class Grip(NamedTuple):
    """How the driver's arms hold the wheel."""

    inertia_kg_m2: float
    damping_n_m_s: float
    stiffness_n_m: float


GRIPS: Mapping[str, Grip] = MappingProxyType(
    {
        "hands_off": Grip(0.0, 0.0, 0.0),
        "loose": Grip(0.01, 0.15, 1.0),
        "light": Grip(0.03, 0.5, 5.0),
        "firm": Grip(0.08, 1.5, 40.0),
    }
)
"""Chosen."""


class WheelSettings(Settings):
    """`[wheel]`: the wheel and its motor; the defaults are chosen."""

    inertia_kg_m2: float = Field(0.035, ge=1e-4, le=10.0)
    damping_n_m_s: float = Field(0.15, ge=0.0, le=100.0)
    friction_n_m: float = Field(0.1, ge=0.0, le=20.0)
    """Coulomb friction: the wheel sticks."""
    stop_rad: float = Field(9.0, ge=0.1, le=13.0)
    """Angle of the end stop on either side; the default is three turns from stop to stop."""
    motor_lag_s: float = Field(0.004, ge=1e-4, le=1.0)
    torque_n_m_max: float = Field(10.0, ge=0.1, le=20.0)
    """Largest torque of the motor."""
    sensor_n_m_rad: float = Field(0.0, ge=0.0, le=1000.0)
    """Stiffness of the torque sensor, between rim and motor; 0: rigid."""
    rim_share: float = Field(0.85, gt=0.0, lt=1.0)
    """Share of the inertia that is above a torque sensor with a stiffness."""


def held_wheel(wheel: WheelSettings, grip: Grip) -> LinearSystem:
    """Return the system from commanded torque [N m] to angle [rad].

    Its states are θ, θ', T; with a sensor that gives way, θ_r and θ_r' follow.
    """
    if wheel.sensor_n_m_rad != 0.0:
        return _parted_wheel(wheel, grip)
    inertia_kg_m2 = wheel.inertia_kg_m2 + grip.inertia_kg_m2
    damping_n_m_s = wheel.damping_n_m_s + grip.damping_n_m_s
    a = [
        [0.0, 1.0, 0.0],
        [-grip.stiffness_n_m / inertia_kg_m2, -damping_n_m_s / inertia_kg_m2, -1.0 / inertia_kg_m2],
        [0.0, 0.0, -1.0 / wheel.motor_lag_s],
    ]
    b, c = [0.0, 0.0, 1.0 / wheel.motor_lag_s], [1.0, 0.0, 0.0]
    return LinearSystem(np.array(a), np.array(b), np.array(c))


def sensed_torque(wheel: WheelSettings, grip: Grip) -> Matrix:
    """Return the row that gives the arms' torque at the sensor from the states of that system."""
    if (sensor_n_m_rad := wheel.sensor_n_m_rad) != 0.0:
        return np.array([-sensor_n_m_rad, 0.0, 0.0, sensor_n_m_rad, 0.0])
    acceleration = held_wheel(wheel, grip).a[1]
    resisted = np.array([grip.stiffness_n_m, grip.damping_n_m_s, 0.0])
    return np.asarray(-resisted - grip.inertia_kg_m2 * acceleration)


def _parted_wheel(wheel: WheelSettings, grip: Grip) -> LinearSystem:
    sensor_n_m_rad, above_kg_m2 = wheel.sensor_n_m_rad, wheel.rim_share * wheel.inertia_kg_m2
    below_kg_m2 = wheel.inertia_kg_m2 - above_kg_m2
    below = wheel.model_copy(update={"inertia_kg_m2": below_kg_m2, "sensor_n_m_rad": 0.0})
    on_sensor, a = held_wheel(below, Grip(0.0, 0.0, sensor_n_m_rad)), np.zeros((5, 5))
    a[:3, :3], a[1, 3], a[3, 4] = on_sensor.a, sensor_n_m_rad / below_kg_m2, 1.0
    by_rim = sensor_n_m_rad, -grip.stiffness_n_m - sensor_n_m_rad, -grip.damping_n_m_s
    a[4, [0, 3, 4]] = np.array(by_rim) / (above_kg_m2 + grip.inertia_kg_m2)
    return LinearSystem(a, np.append(on_sensor.b, [0.0, 0.0]), np.append(on_sensor.c, [0.0, 0.0]))


def kept_of(cutoff_rad_s: float, cycle_s: float) -> float:
    """Return the share of a low-pass's state that a cycle leaves."""
    return exp(-cutoff_rad_s * cycle_s)
