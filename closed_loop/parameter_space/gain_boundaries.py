"""Boundary crossing: where in the plane of the gains (K_p, K_d) a root of the loop sits on ∂Γ.

∂Γ is the boundary of the D-stable set of roots s. The loop 1 + P (K_p + K_d s) = 0 has a root on it
where

    K_p + K_d s = f(s),   f = -1/P,   s on ∂Γ

    complex root    s not real: real and imaginary part are two equations,
                    K_d = Im f/Im s,  K_p = Re f - K_d Re s:      one point for each s, a curve
    real root       s real: one equation, a straight line; s = -σ and s = -R

(J. Ackermann, Robust Control: Systems with Uncertain Physical Parameters, 1993.) No grid of gains
is searched. The σ line, the cone and the circle are followed only where a crossing can change the
verdict of ``judge``: the cone within R, and cone and circle left of -σ. -1/P is used and not P,
because the vehicle's two integrators are poles of P at s = 0 and harmless in 1/P.
"""

import math
from collections.abc import Iterable
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from ...controller.analysis.linear_system import polynomials
from ...controller.filters.transfer_function import TransferFunction
from ...runtime.array_types import ComplexArray, FloatArray
from .d_stability import DStability, judge

_POINTS = 2000
_NEAR, _FAR = 1e-3, 1e4
"""First and last point of the straight line, in R; and where others begin off the real axis."""


class Bound(StrEnum):
    """Which of the demands."""

    SIGMA = "σ"  # noqa: RUF001  # the paper's symbol
    CONE = "θ"
    RADIUS = "R"


class RootKind(StrEnum):
    """How a root crosses the boundary."""

    COMPLEX = "complex"
    REAL = "real"


class BoundaryCurve(NamedTuple):
    """One boundary; ``gains`` are (K_p, K_d), shape (n, 2), and a root is at each ``s_rad_s``."""

    bound: Bound
    kind: RootKind
    gains: FloatArray
    s_rad_s: ComplexArray


def boundary_curves(
    model: TransferFunction, spec: DStability, k_d_ends_rad_s_m: tuple[float, float]
) -> tuple[BoundaryCurve, ...]:
    """Return every boundary of a plant under K_p + K_d s.

    ``model``             from wheel angle [rad] to lateral error [m]
    ``k_d_ends_rad_s_m``  between which straight lines are returned
    """
    inverse, (sigma, theta, radius) = model.inverse(), spec
    widest_rad = math.acos(sigma / radius)
    pieces = {
        Bound.SIGMA: -sigma + 1j * radius * np.geomspace(_NEAR, _FAR, _POINTS),
        Bound.RADIUS: -radius * np.exp(-1j * np.linspace(_NEAR, widest_rad, _POINTS)),
    }
    apex = sigma / -math.cos(theta)
    if apex < radius:
        distances = np.linspace(max(apex, _NEAR * radius), radius, _POINTS)
        pieces[Bound.CONE] = distances * np.exp(1j * theta)
    curves = []
    for bound, s in pieces.items():
        wanted = -inverse.response(s)
        k_d = wanted.imag / s.imag
        gains = np.column_stack([wanted.real - k_d * s.real, k_d])
        curves.append(BoundaryCurve(bound, RootKind.COMPLEX, gains, s))
    for bound, root in ((Bound.SIGMA, -sigma), (Bound.RADIUS, -radius)):
        s = np.full(2, complex(root))
        k_d = np.array(k_d_ends_rad_s_m)
        gains = np.column_stack([-inverse.response(s).real - k_d * root, k_d])
        curves.append(BoundaryCurve(bound, RootKind.REAL, gains, s))
    return tuple(curves)


def meets_demands(
    models: Iterable[TransferFunction], spec: DStability, k_p_rad_m: float, k_d_rad_s_m: float
) -> bool:
    """Whether the roots of the loop meet the specification with each plant, such as the corners."""
    gains = np.array([[k_p_rad_m, k_d_rad_s_m]])
    return all(judge(spec, closed_loop_roots(model, gains)).satisfied[0] for model in models)


def closed_loop_roots(model: TransferFunction, gains: FloatArray) -> ComplexArray:
    """Return the roots s of the loop at gains (K_p, K_d) of shape (n, 2), shape (n, roots).

    Raises ValueError unless plant and controller together are strictly proper: then no root can
    pass through infinity.
    """
    zeros, poles = polynomials(model)
    if len(poles) < len(zeros) + 2:
        raise ValueError("plant and controller together have to be strictly proper")
    parts = (poles, zeros, np.polymul(zeros, [1.0, 0.0]))
    characteristic = np.array([np.pad(part, (len(poles) - len(part), 0)) for part in parts])
    coefficients = np.column_stack([np.ones(len(gains)), gains]) @ characteristic
    order = coefficients.shape[1] - 1
    companion = np.zeros((len(gains), order, order))
    companion[:] = np.eye(order, k=-1)
    companion[:, 0] = -coefficients[:, 1:] / coefficients[:, :1]
    return np.linalg.eigvals(companion).astype(np.complex128)
