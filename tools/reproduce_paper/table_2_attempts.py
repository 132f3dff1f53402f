"""Attempts to explain Table II's PD+DOB row, none of them adopted.

Each is one thing that the authors may have done otherwise. Where it has a free number, the number
is the one that comes closest to the published row (least squares over the four corners).

    lower cut-off   Q of (20) with another ω_c
    τ = 5 s         for ω_c = 5 rad/s, τ = 1/ω_c
    weaker Q        g Q with a gain g < 1 at rest
    own command     the observer is fed with the PD's command instead of the whole (v = -C y)
    other point     the error of a point d ahead of the centre of gravity, while (11) holds that of
                    the preview point at zero. In a steady turn at walking speed the side slip is
                    l_r ρ, so that y_d = ρ (l_s - d) (l_r + (l_s + d)/2)
    printed C_r     50,000 N/rad in (11) as published

Other readings of the text that could explain Table II's PD row, and their results.

initial offset   no path at all: the vehicle starts beside a straight road. One free number,
                 the offset, at the best fit
J V²             a22 as misprinted in (2), which (19) has, on the inferred ellipse
"""

from collections.abc import Callable, Iterator
from math import exp, log

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.signal import StateSpace, lsim

from ...loop_theory.uncertainty import paper_box
from ...pair.trace import rms
from ...plant_emulator.vehicle import VehicleParams, state_matrices
from ...runtime.array_types import FloatArray
from . import published
from .continuous_runs import (
    K_D_RAD_S_M,
    K_P_RAD_M,
    DrivenEllipse,
    curvature_met,
    order_2,
    table_2_row,
)

_PER_METRE = np.array([0.0, 0.0, 0.0, 1.0])

PATH = DrivenEllipse(78.2, 41.74, 200.0)
"""Inferred from the PD row; see figure_14."""

Q_CUTOFF_RAD_S = 5.0
"""As published."""

_CUTOFF_RAD_S_MIN, _CUTOFF_RAD_S_MAX = 0.01, 5.0
_TOLERANCE = 1e-3


def attempts() -> Iterator[tuple[str, tuple[float, ...]]]:
    """Yield each attempt's description and its row [m]."""
    cutoff_rad_s = exp(
        _closest(
            lambda x: table_2_row(order_2(exp(x)), PATH),
            log(_CUTOFF_RAD_S_MIN),
            log(_CUTOFF_RAD_S_MAX),
        )
    )
    yield (
        f"lower cut-off, ω_c = {cutoff_rad_s:.3f} rad/s",
        table_2_row(order_2(cutoff_rad_s), PATH),
    )
    yield "τ = 5 s instead of ω_c = 5 rad/s", table_2_row(order_2(1.0 / Q_CUTOFF_RAD_S), PATH)
    gain = _closest(lambda g: table_2_row(order_2(Q_CUTOFF_RAD_S, g), PATH), 0.0, 1.0)
    yield f"weaker Q, gain {gain:.2f} at rest", table_2_row(order_2(Q_CUTOFF_RAD_S, gain), PATH)
    fed_with_wish = order_2(Q_CUTOFF_RAD_S)._replace(fed_with_own_command=False)
    yield "observer fed with the PD's wish", table_2_row(fed_with_wish, PATH)
    point_m = _closest(_at_point, 0.0, paper_box().nominal.preview_distance_m)
    yield f"error of a point {point_m:.2f} m ahead of the CG", _at_point(point_m)
    yield (
        "printed C_r = 50,000 N/rad",
        table_2_row(order_2(Q_CUTOFF_RAD_S), PATH, published.REAR_CORNERING_STIFFNESS_N_RAD),
    )


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
