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
"""

from collections.abc import Callable, Iterator
from math import exp, log

import numpy as np
from scipy.optimize import minimize_scalar

from ...loop_theory.uncertainty import paper_box
from ...pair.trace import rms
from . import published
from .continuous_runs import DrivenEllipse, curvature_met, order_2, table_2_row

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
