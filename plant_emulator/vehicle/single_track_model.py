"""Single-track vehicle that follows a path: eq. (1) of SAE 2018-01-1086 with eq. (2) corrected.

    β'  = a11 β + a12 r + b11 δ + wβ
    r'  = a21 β + a22 r + b21 δ + wr
    Δψ' = r − V ρ
    y'  = V β + l_s r + V Δψ

    a11 = −(c_r + c_f)/(m̃ V)             a12 = −1 + (c_r l_r − c_f l_f)/(m̃ V²)
    a21 = (c_r l_r − c_f l_f)/J          a22 = −(c_r l_r² + c_f l_f²)/(J V)
    b11 = c_f/(m̃ V)                      b21 = c_f l_f/J

    β   side_slip_rad       of the velocity of the centre of gravity (CG) against the vehicle's axis
    r   yaw_rate_rad_s
    Δψ  heading_error_rad   against the path's tangent at the preview point
    y   lateral_error_m     of the preview point, which lies l_s ahead of the CG
    δ   steering angle of the front wheel [rad]
    ρ   curvature of the path at the preview point [1/m]: there y' is exact as printed
    wβ, wr   disturbance accelerations of side slip [rad/s] and yaw rate [rad/s²], not in the paper

Corrected against the printed (2): a22 divides by J V (printed J V², which is no 1/s), and the yaw
input is b21 (printed b12). ISO 8855 signs: y to the left, left steer and left curvature positive.
Linear in small angles, at constant speed.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Matrix = npt.NDArray[np.float64]


class VehicleParams(NamedTuple):
    """The symbols of (2), for one vehicle at one speed."""

    speed_m_s: float
    """V."""
    virtual_mass_kg: float
    """m̃ = m/μ of the paper: a mass on less friction drifts like a larger one."""
    yaw_inertia_kg_m2: float
    """J."""
    front_cornering_stiffness_n_rad: float
    """c_f, cornering stiffness of the axle."""
    rear_cornering_stiffness_n_rad: float
    """c_r, cornering stiffness of the axle."""
    front_axle_distance_m: float
    """l_f, from the CG to the front axle."""
    rear_axle_distance_m: float
    """l_r, from the CG to the rear axle."""
    preview_distance_m: float
    """l_s, from the CG to the preview point. Not printed; the paper's (19) takes 2 m."""


class StateMatrices(NamedTuple):
    """x' = A x + B u with x = (β, r, Δψ, y) and u = (δ, ρ, wβ, wr); SI units."""

    a: Matrix
    """4 by 4."""
    b: Matrix
    """4 by 4, one column per input."""


def state_matrices(p: VehicleParams) -> StateMatrices:
    """Return (1) as matrices."""
    v, m, j, c_f, c_r, l_f, l_r, l_s = p
    a11 = -(c_r + c_f) / (m * v)
    a12 = -1.0 + (c_r * l_r - c_f * l_f) / (m * v * v)
    a21 = (c_r * l_r - c_f * l_f) / j
    a22 = -(c_r * l_r * l_r + c_f * l_f * l_f) / (j * v)
    b11 = c_f / (m * v)
    b21 = c_f * l_f / j
    a = [[a11, a12, 0.0, 0.0], [a21, a22, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [v, l_s, v, 0.0]]
    b = [[b11, 0.0, 1.0, 0.0], [b21, 0.0, 0.0, 1.0], [0.0, -v, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0]]
    return StateMatrices(np.array(a), np.array(b))


def front_slip_rad(p: VehicleParams, wheel_rad: float, beta: float, r: float) -> float:
    """Return the slip angle of the front tyres, δ - β - l_f r/V: their lateral force over c_f."""
    return wheel_rad - beta - p.front_axle_distance_m * r / p.speed_m_s


def on_friction(p: VehicleParams, friction: float) -> VehicleParams:
    """Return the vehicle on a road whose friction is ``friction`` times that of ``p``.

    Both cornering stiffnesses scale, in the yaw equation too, as tyres do. The paper's virtual mass
    leaves the yaw equation as it is: for its corners, change ``virtual_mass_kg``.
    """
    return p._replace(
        front_cornering_stiffness_n_rad=friction * p.front_cornering_stiffness_n_rad,
        rear_cornering_stiffness_n_rad=friction * p.rear_cornering_stiffness_n_rad,
    )
