"""Continuous, linear runs along an ellipse, for Table II.

No sampling, no limits, no delay. Independent of the nodes: the loop from path curvature to lateral
error is one rational function, driven by the curvature the vehicle meets. With G = N/(s² D) of (4),
G_n = N_n/(s² D_n), -V²/s² of (5), Q = A/B, C = K_p + K_d s, and the steer of (11),

    u = -C y - (Q/G_n) y + Q u

the lateral error is

    y/ρ = -V² (B - A) D N_n / (s² D (B - A) N_n + N (C B N_n + A s² D_n))

in which the two integrators of the vehicle have cancelled against the curvature's.
"""

from typing import NamedTuple

import numpy as np
from scipy.signal import lsim

from ...closed_loop.pair_result import rms
from ...closed_loop.parameter_space.uncertainty import paper_box
from ...controller.filters.nominal_model import NominalVehicle, paper_eq19, steer_to_lateral_error
from ...controller.filters.transfer_function import TransferFunction
from ...plant_emulator.path.ellipse_and_lane_changes import ellipse
from ...runtime.array_types import FloatArray
from .continuous_loop import product

_STEP_S = 0.05
"""The curvature is linear between break points, and lsim is exact for linear input."""
K_P_RAD_M, K_D_RAD_S_M = 1.0596, 0.939


class Observer(NamedTuple):
    """A DOB with G_n of (19): Q = A/B, coefficients highest first."""

    numerator: tuple[float, ...]
    denominator: tuple[float, ...]


class DrivenEllipse(NamedTuple):
    """A path and how long it is driven, from the end of the major axis on."""

    semi_major_axis_m: float
    semi_minor_axis_m: float
    duration_s: float

    def __str__(self) -> str:
        return (
            f"{self.semi_major_axis_m:g} m by {self.semi_minor_axis_m:g} m, {self.duration_s:g} s"
        )


PD = Observer((0.0,), (1.0,))
"""No observer: Q = 0."""


def order_2(cutoff_rad_s: float) -> Observer:
    """Return (11) with Q of (20)."""
    tau_s = 1.0 / cutoff_rad_s
    return Observer((1.0,), (tau_s**2, 2.0 * tau_s, 1.0))


def table_2_row(
    observer: Observer, path: DrivenEllipse, rear_cornering_stiffness_n_rad: float = 500e3
) -> tuple[float, ...]:
    """Return the RMS lateral error [m] of the four corners, in the order of Table II."""
    return tuple(
        rms(lateral_error_m(observer, vehicle, path))
        for vehicle in paper_box(rear_cornering_stiffness_n_rad).vertices()
    )


def lateral_error_m(observer: Observer, vehicle: NominalVehicle, path: DrivenEllipse) -> FloatArray:
    """Return the lateral error every 50 ms [m]. Raises ValueError if the loop is unstable."""
    numerator, denominator = _curvature_to_error(observer, vehicle)
    if float(np.max(np.roots(denominator).real)) >= 0.0:
        raise ValueError("the continuous loop is unstable")
    time_s, rho_1_m = curvature_met(vehicle.speed_m_s, path)
    _, error_m, _ = lsim((numerator, denominator), rho_1_m, time_s)
    return np.asarray(error_m, dtype=np.float64)


def curvature_met(speed_m_s: float, path: DrivenEllipse) -> tuple[FloatArray, FloatArray]:
    """Return times every 50 ms [s] and the curvature beside the preview point then [1/m]."""
    shape = ellipse(path.semi_major_axis_m, path.semi_minor_axis_m)
    time_s = np.arange(0.0, path.duration_s + 0.5 * _STEP_S, _STEP_S)
    s_m = np.array([*shape.start_m, shape.length_m])
    rho_1_m = np.array([*shape.curvature_1_m, shape.curvature_1_m[0]])
    met_1_m = np.interp(speed_m_s * time_s, s_m, rho_1_m, period=shape.length_m)
    return time_s, np.asarray(met_1_m, dtype=np.float64)


def _curvature_to_error(
    observer: Observer, vehicle: NominalVehicle
) -> tuple[FloatArray, FloatArray]:
    """Return the coefficients of y/ρ, highest first."""
    (n,), (d,) = _of(steer_to_lateral_error(vehicle))
    (n_n,), (d_n,) = _of(paper_eq19())
    a, b = np.array(observer.numerator), np.array(observer.denominator)
    s_2, c = np.array([1.0, 0.0, 0.0]), np.array([K_D_RAD_S_M, K_P_RAD_M])
    left = np.polysub(b, a)
    numerator = -(vehicle.speed_m_s**2) * product(left, d, n_n)
    feedback = np.polyadd(product(c, b, n_n), product(a, s_2, d_n))
    denominator = np.polyadd(product(s_2, d, left, n_n), np.polymul(n, feedback))
    return numerator, np.asarray(denominator, dtype=np.float64)


def _of(model: TransferFunction) -> tuple[list[FloatArray], list[FloatArray]]:
    """Return numerator and denominator of N/(s² D) without the integrators."""
    return [np.array(f) for f in model.numerator], [np.array(f) for f in model.denominator]


PATH = DrivenEllipse(78.2, 41.74, 200.0)
"""Inferred from the PD row; see figure_14."""
