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
gains. So R bounds the dominant pair. Roots beyond R have to settle and may be outside the cone;
``every_root_in_cone`` demands the cone of them too, and ``every_root_damped`` reports it in any
case.

Dominant means nearest the origin, not rightmost. A verdict can then change only where a root
crosses the σ line, the cone or the circle, on which the boundary crossing of
``closed_loop.parameter_space.gain_regions`` relies.

A continuous loop with an exact delay,

    Δ(s) = p(s) + q(s) e^(-sT),   deg q < deg p

has infinitely many roots, which cannot be listed. But the demands are counts: none with Re s ≥ -σ,
at least two with |s| ≤ R, none of those outside the cone. Δ is entire, so each count is the number
of turns that Δ makes around zero as s goes around the area (argument principle). e^(-sT) is
evaluated exactly. Not *every* root can be in the cone: far from the origin the roots line up along
|q| e^(-T Re s) = |p|, where Re s grows only as the logarithm of Im s.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ...runtime.array_types import BoolArray, ComplexArray, FloatArray
from ...runtime.node import NS_PER_S
from .root_count import Polynomial, count_roots, followed

_DOMINANT_ROOTS = 2
_MODULUS_MIN = 1e-300
"""A root at z = 0 has no logarithm; roots this small decay at once and do not matter."""


class DStability(NamedTuple):
    """σ [1/s], θ [rad] from the positive real axis, R [rad/s]; made by ``d_stability``."""

    sigma_1_s: float
    cone_angle_rad: float
    radius_rad_s: float
    every_root_in_cone: bool = False


class Judgement(NamedTuple):
    """Which demands each set of roots meets; arrays of bool, one element per set.

    ``every_root_damped``  the whole loop is in the cone, demanded or not
    ``satisfied``          all that is demanded is met
    """

    settled: BoolArray
    damped: BoolArray
    dominant: BoolArray
    every_root_damped: BoolArray
    satisfied: BoolArray


def d_stability(
    sigma_1_s: float,
    cone_angle_deg: float,
    radius_rad_s: float,
    *,
    every_root_in_cone: bool = False,
) -> DStability:
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
    return DStability(sigma_1_s, math.radians(cone_angle_deg), radius_rad_s, every_root_in_cone)


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
    every_root_damped = np.all(in_cone, axis=-1)
    satisfied = settled & damped & dominant
    if spec.every_root_in_cone:
        satisfied &= every_root_damped
    return Judgement(
        *(np.asarray(part) for part in (settled, damped, dominant, every_root_damped, satisfied))
    )


_FIRST_POINTS = 200


def delayed_loop_satisfies(
    spec: DStability, undelayed: Polynomial, delayed: Polynomial, delay_s: float
) -> bool:
    """Whether the roots of p + q e^(-sT) meet the specification; ``undelayed`` is p, T > 0.

    Raises ValueError unless deg q < deg p.
    """
    if spec.every_root_in_cone:
        return False
    sigma, theta, radius, _ = spec
    growth = math.exp(sigma * delay_s)
    settled = count_roots(_shifted(undelayed, sigma), _shifted(delayed, sigma) * growth, delay_s)
    if not settled.stable:
        return False

    def delta(s_rad_s: ComplexArray) -> ComplexArray:
        answer = np.polyval(delayed, s_rad_s) * np.exp(-s_rad_s * delay_s)
        return np.asarray(np.polyval(undelayed, s_rad_s) + answer, dtype=np.complex128)

    if roots_within(delta, lambda x: radius * np.exp(2j * math.pi * x)) < _DOMINANT_ROOTS:
        return False

    def outside_the_cone(x: FloatArray) -> ComplexArray:
        """Go out along one ray of the cone, around the circle and back along the other."""
        distance = radius * np.clip(np.minimum(3.0 * x, 3.0 - 3.0 * x), 0.0, 1.0)
        angle_rad = theta * np.clip(6.0 * x - 3.0, -1.0, 1.0)
        return np.asarray(distance * np.exp(1j * angle_rad), dtype=np.complex128)

    return roots_within(delta, outside_the_cone) == 0


def roots_within(
    function: Callable[[ComplexArray], ComplexArray], contour: Callable[[FloatArray], ComplexArray]
) -> int:
    """Return how many zeros of an entire function a closed contour encloses, with multiplicity.

    ``contour`` maps [0, 1] to the contour, once around counterclockwise.
    """
    points = np.linspace(0.0, 1.0, _FIRST_POINTS)
    *_, turned_rad = followed(lambda x: function(contour(x)), points)
    return round(turned_rad / (2.0 * math.pi))


def _shifted(polynomial: Polynomial, sigma_1_s: float) -> Polynomial:
    """Return p(s - σ) as a polynomial in s, by Horner's rule."""
    shifted = np.array([0.0])
    for coefficient in polynomial:
        shifted = np.polyadd(np.polymul(shifted, [1.0, -sigma_1_s]), [coefficient])
    return shifted
