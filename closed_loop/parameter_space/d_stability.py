"""D-stability: where the roots of a loop have to lie, and whether they do.

SAE 2018-01-1086, section V.A, gives three numbers: a settling constraint σ, a damping constraint θ
and a bandwidth constraint R. For a root s = ln(z)/T of a sampled loop (principal strip), or s
itself of a continuous one:

    settled    Re s < -σ                        every root
    damped     |arg s| ≥ θ                      every root with |s| ≤ R; 135° is a damping ratio of
                                                cos 45° = 0.71
    dominant   |s| ≤ R                          at least the two roots nearest the origin

R cannot bound every root, though the text reads as if it did: the sum of all roots of (19) with a
PD around it is -459.2 - 227.6 K_d rad/s, so two of the four are at hundreds of rad/s whatever the
gains. So R bounds the dominant pair. Roots beyond R have to settle and may be outside the cone.

Dominant means nearest the origin, not rightmost. A verdict can then change only where a root
crosses the σ line, the cone or the circle, on which the boundary crossing of
``closed_loop.parameter_space.gain_boundaries`` relies.
"""

import math
from typing import NamedTuple

import numpy as np

from ...runtime.array_types import BoolArray, ComplexArray
from ...runtime.node import NS_PER_S

_DOMINANT_ROOTS = 2
_MODULUS_MIN = 1e-300
"""A root at z = 0 has no logarithm; roots this small decay at once and do not matter."""


class DStability(NamedTuple):
    """σ [1/s], θ [rad] from the positive real axis, R [rad/s]; made by ``d_stability``."""

    sigma_1_s: float
    cone_angle_rad: float
    radius_rad_s: float


class Judgement(NamedTuple):
    """Which demands each set of roots meets, and whether all; arrays of bool, one element a set."""

    settled: BoolArray
    damped: BoolArray
    dominant: BoolArray
    satisfied: BoolArray


def d_stability(sigma_1_s: float, cone_angle_deg: float, radius_rad_s: float) -> DStability:
    """Return the specification; raises ValueError if no pair of roots can meet it."""
    if not 0.0 <= sigma_1_s < math.inf:
        raise ValueError(f"sigma = {sigma_1_s:g} 1/s must be at least 0")
    if not 90.0 < cone_angle_deg < 180.0:
        raise ValueError(
            f"the cone angle {cone_angle_deg:g}° must be above 90° and below 180°; 135° is a"
            " damping ratio of 0.71"
        )
    if not sigma_1_s < radius_rad_s < math.inf:
        raise ValueError(
            f"the radius {radius_rad_s:g} rad/s must be above sigma = {sigma_1_s:g} 1/s: the"
            " dominant roots have to lie between them"
        )
    return DStability(sigma_1_s, math.radians(cone_angle_deg), radius_rad_s)


def paper_d_stability() -> DStability:
    """Return σ = 0.3, θ = 135° and R = 1.3 rad/s of section V.A."""
    return d_stability(0.3, 135.0, 1.3)


def in_s_plane(roots_z: ComplexArray, period_ns: int) -> ComplexArray:
    """Return s = ln(z)/T [rad/s], -π/T < Im s ≤ π/T."""
    modulus = np.maximum(np.abs(roots_z), _MODULUS_MIN)
    s_rad_s = (np.log(modulus) + 1j * np.angle(roots_z)) * NS_PER_S / period_ns
    return np.asarray(s_rad_s, dtype=np.complex128)


def judge(spec: DStability, roots_rad_s: ComplexArray) -> Judgement:
    """Judge sets of roots s, of shape (..., roots); the answers have shape (...)."""
    modulus = np.abs(roots_rad_s)
    within = modulus <= spec.radius_rad_s
    in_cone = roots_rad_s.real <= modulus * math.cos(spec.cone_angle_rad)
    settled = np.all(roots_rad_s.real < -spec.sigma_1_s, axis=-1)
    damped = np.all(in_cone | ~within, axis=-1)
    dominant = np.count_nonzero(within, axis=-1) >= _DOMINANT_ROOTS
    verdicts = settled, damped, dominant, settled & damped & dominant
    return Judgement(*map(np.asarray, verdicts))
