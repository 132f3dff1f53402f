"""Continuous, linear runs along an ellipse, for Table II, and attempts to explain its two rows.

No sampling, no limits, no delay. Independent of the nodes: the loop from path curvature to lateral
error is one rational function, driven by the curvature the vehicle meets. With G = N/(s² D) of (4),
G_n = N_n/(s² D_n), -V²/s² of (5), Q = A/B, C = K_p + K_d s, and the steer

    u = -C y - (Q/G_n) y + Q v         v = u: (11);  v = -C y: fed with the PD's wish alone

the lateral error is

    v = u     y/ρ = -V² (B - A) D N_n / (s² D (B - A) N_n + N (C B N_n + A s² D_n))
    v = -C y  y/ρ = -V² B D N_n / (s² D B N_n + N (C (A + B) N_n + A s² D_n))

in which the two integrators of the vehicle have cancelled against the curvature's.

No attempt is adopted. Each is one thing that the authors may have done otherwise. Where it has a
free number, the number is the one that comes closest to the published row (least squares over the
four corners). For the PD+DOB row:

    lower cut-off   Q of (20) with another ω_c
    τ = 5 s         for ω_c = 5 rad/s, τ = 1/ω_c
    weaker Q        g Q with a gain g < 1 at rest
    own command     the observer is fed with the PD's command instead of the whole (v = -C y)
    other point     the error of a point d ahead of the centre of gravity, while (11) holds that of
                    the preview point at zero. In a steady turn at walking speed the side slip is
                    l_r ρ, so that y_d = ρ (l_s - d) (l_r + (l_s + d)/2)
    printed C_r     50,000 N/rad in (11) as published

For the PD row:

    initial offset  no path at all: the vehicle starts beside a straight road. One free number,
                    the offset, at the best fit
    J V²            a22 as misprinted in (2), which (19) has, on the inferred ellipse
"""

from collections.abc import Callable, Iterator
from math import exp, log
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.signal import StateSpace, lsim

from ...closed_loop.pair_result import rms
from ...closed_loop.parameter_space.uncertainty import paper_box
from ...controller.filters.nominal_model import NominalVehicle, paper_eq19, steer_to_lateral_error
from ...controller.filters.transfer_function import TransferFunction
from ...plant_emulator.path.shapes import ellipse
from ...plant_emulator.vehicle.single_track_model import VehicleParams, state_matrices
from ...runtime.array_types import FloatArray
from . import published
from .continuous_loop import product

_STEP_S = 0.05
"""The curvature is linear between break points, and lsim is exact for linear input."""
K_P_RAD_M, K_D_RAD_S_M = 1.0596, 0.939


class Observer(NamedTuple):
    """A DOB: Q = A/B, coefficients highest first, and which command it is fed with."""

    numerator: tuple[float, ...]
    denominator: tuple[float, ...]
    fed_with_own_command: bool
    model: TransferFunction


class DrivenEllipse(NamedTuple):
    """A path and how long it is driven, from the end of the major axis on."""

    semi_major_axis_m: float
    semi_minor_axis_m: float
    duration_s: float

    def __str__(self) -> str:
        return (
            f"{self.semi_major_axis_m:g} m by {self.semi_minor_axis_m:g} m, {self.duration_s:g} s"
        )


PD = Observer((0.0,), (1.0,), True, paper_eq19())
"""No observer: Q = 0."""


def order_2(cutoff_rad_s: float, gain: float = 1.0) -> Observer:
    """Return (11) with gain·Q of (20)."""
    tau_s = 1.0 / cutoff_rad_s
    return Observer((gain,), (tau_s**2, 2.0 * tau_s, 1.0), True, paper_eq19())


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
    (n_n,), (d_n,) = _of(observer.model)
    a, b = np.array(observer.numerator), np.array(observer.denominator)
    s_2, c = np.array([1.0, 0.0, 0.0]), np.array([K_D_RAD_S_M, K_P_RAD_M])
    left, doubled = (
        (np.polysub(b, a), b) if observer.fed_with_own_command else (b, np.polyadd(a, b))
    )
    numerator = -(vehicle.speed_m_s**2) * product(left, d, n_n)
    feedback = np.polyadd(product(c, doubled, n_n), product(a, s_2, d_n))
    denominator = np.polyadd(product(s_2, d, left, n_n), np.polymul(n, feedback))
    return numerator, np.asarray(denominator, dtype=np.float64)


def _of(model: TransferFunction) -> tuple[list[FloatArray], list[FloatArray]]:
    """Return numerator and denominator of N/(s² D) without the integrators."""
    return [np.array(f) for f in model.numerator], [np.array(f) for f in model.denominator]


_PER_METRE = np.array([0.0, 0.0, 0.0, 1.0])

PATH = DrivenEllipse(78.2, 41.74, 200.0)
"""Inferred from the PD row; see figure_14."""

Q_CUTOFF_RAD_S = 5.0
"""As published."""

_CUTOFF_RAD_S_MIN, _CUTOFF_RAD_S_MAX = 0.01, 5.0
_TOLERANCE = 1e-3


def attempts() -> Iterator[tuple[str, tuple[float, ...]]]:
    """Yield each attempt's description and its row [m]."""

    def row(cutoff_rad_s: float, gain: float = 1.0) -> tuple[float, ...]:
        return table_2_row(order_2(cutoff_rad_s, gain), PATH)

    ends = log(_CUTOFF_RAD_S_MIN), log(_CUTOFF_RAD_S_MAX)
    cutoff_rad_s = exp(_closest(lambda x: row(exp(x)), *ends))
    yield f"lower cut-off, ω_c = {cutoff_rad_s:.3f} rad/s", row(cutoff_rad_s)
    yield "τ = 5 s instead of ω_c = 5 rad/s", row(1.0 / Q_CUTOFF_RAD_S)
    gain = _closest(lambda g: row(Q_CUTOFF_RAD_S, g), 0.0, 1.0)
    yield f"weaker Q, gain {gain:.2f} at rest", row(Q_CUTOFF_RAD_S, gain)
    published_dob = order_2(Q_CUTOFF_RAD_S)
    fed_with_wish = published_dob._replace(fed_with_own_command=False)
    yield "observer fed with the PD's wish", table_2_row(fed_with_wish, PATH)
    point_m = _closest(_at_point, 0.0, paper_box().nominal.preview_distance_m)
    yield f"error of a point {point_m:.2f} m ahead of the CG", _at_point(point_m)
    printed = table_2_row(published_dob, PATH, published.REAR_CORNERING_STIFFNESS_N_RAD)
    yield "printed C_r = 50,000 N/rad", printed


def _closest(row_of: Callable[[float], tuple[float, ...]], minimum: float, maximum: float) -> float:
    """Return the argument whose row comes closest to the published one."""
    target_m = np.array([column.pd_dob_m for column in published.TABLE_2])
    result = minimize_scalar(
        lambda x: float(np.sum(np.square(np.array(row_of(x)) - target_m))) * 1e6,
        bounds=(minimum, maximum),
        method="bounded",
        options={"xatol": _TOLERANCE},
    )
    return float(result.x)


def _at_point(point_m: float) -> tuple[float, ...]:
    """Return the RMS errors of a point ``point_m`` ahead of the centre of gravity [m]."""
    row = []
    for vehicle in paper_box().vertices():
        behind_m = vehicle.preview_distance_m - point_m
        lever_m = vehicle.rear_axle_distance_m + 0.5 * (vehicle.preview_distance_m + point_m)
        _, rho_1_m = curvature_met(vehicle.speed_m_s, PATH)
        row.append(rms(behind_m * lever_m * rho_1_m))
    return tuple(row)


def pd_row_attempts() -> Iterator[tuple[str, tuple[float, ...]]]:
    """Yield each reading's description and its row [m]."""
    of_one_metre = np.array([_rms_m(vehicle, offset_m=1.0) for vehicle in _corners()])
    published_m = np.array([column.pd_m for column in published.TABLE_2])
    offset_m = float(of_one_metre @ published_m / (of_one_metre @ of_one_metre))
    row_m = tuple(float(value) for value in offset_m * of_one_metre)
    yield f"initial offset of {offset_m:.2f} m beside a straight road", row_m
    misprinted = tuple(_rms_m(vehicle, has_misprint=True) for vehicle in _corners())
    yield "a22 with J V² as printed, on the ellipse", misprinted


def _corners() -> list[VehicleParams]:
    return [VehicleParams(vehicle.speed_m_s, *vehicle[:-1]) for vehicle in paper_box().vertices()]


def _rms_m(vehicle: VehicleParams, offset_m: float = 0.0, *, has_misprint: bool = False) -> float:
    """Return the RMS of the continuous PD loop, from an offset or else along the ellipse."""
    a, b = state_matrices(vehicle)
    if has_misprint:
        a[1, 1] /= vehicle.speed_m_s
    closed = a - np.outer(b[:, 0], K_P_RAD_M * _PER_METRE + K_D_RAD_S_M * a[3])
    time_s, curvature_1_m = curvature_met(vehicle.speed_m_s, PATH)
    driven: FloatArray = np.zeros_like(curvature_1_m) if offset_m else curvature_1_m
    loop = StateSpace(closed, b[:, 1:2], _PER_METRE[np.newaxis], np.zeros((1, 1)))
    _, error_m, _ = lsim(loop, driven, time_s, X0=offset_m * _PER_METRE)
    return rms(np.asarray(error_m, dtype=np.float64))
