"""Hand wheel with its feedback motor, and the arms that hold it, as a linear system.

    (J + J_a) θ'' + (b + b_a) θ' + k_a θ = -T          T' = (T_cmd - T)/T_m

    θ      angle of the hand wheel, positive to the left    [rad]
    T      torque of the feedback motor against it          [N m]
    J, b   inertia and damping of the wheel                 [kg m²], [N m s/rad]
    J_a, b_a, k_a   inertia, damping and stiffness of the driver's arms
    T_m    lag of the motor                                 [s]

No impedance of arms at a steering wheel was found published. The four grips are chosen.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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


class HandWheel(NamedTuple):
    """The wheel and its motor; the defaults are chosen."""

    inertia_kg_m2: float = 0.035
    damping_n_m_s: float = 0.15
    motor_lag_s: float = 0.004


def held_wheel(wheel: HandWheel, grip: Grip) -> LinearSystem:
    """Return the system from commanded torque [N m] to angle [rad]; states θ, θ', T."""
    inertia_kg_m2 = wheel.inertia_kg_m2 + grip.inertia_kg_m2
    damping_n_m_s = wheel.damping_n_m_s + grip.damping_n_m_s
    a = [
        [0.0, 1.0, 0.0],
        [-grip.stiffness_n_m / inertia_kg_m2, -damping_n_m_s / inertia_kg_m2, -1.0 / inertia_kg_m2],
        [0.0, 0.0, -1.0 / wheel.motor_lag_s],
    ]
    b, c = [0.0, 0.0, 1.0 / wheel.motor_lag_s], [1.0, 0.0, 0.0]
    return LinearSystem(np.array(a), np.array(b), np.array(c))
