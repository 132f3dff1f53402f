"""D-stability of a continuous loop with an exact delay, from counts of its roots.

    Δ(s) = p(s) + q(s) e^(-sT),   deg q < deg p

has infinitely many roots, which cannot be listed. But the demands of ``loop_theory.d_stability``
are counts: none with Re s ≥ -σ, at least two with |s| ≤ R, none of those outside the cone. Δ is
entire, so each count is the number of turns that Δ makes around zero as s goes around the area
(argument principle). e^(-sT) is evaluated exactly.

Not *every* root can be in the cone: far from the origin the roots line up along |q| e^(-T Re s) =
|p|, where Re s grows only as the logarithm of Im s.
"""

import math
from collections.abc import Callable

import numpy as np

from ..runtime.array_types import ComplexArray, FloatArray
from .d_stability import DStability
from .root_count import Polynomial, count_roots, followed, turns_rad

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

    if roots_within(delta, lambda x: radius * np.exp(2j * math.pi * x)) < 2:
        return False

    def outside_the_cone(x: FloatArray) -> ComplexArray:
        """Go out along one ray of the cone, around the circle and back along the other."""
        distance = radius * np.clip(np.minimum(3.0 * x, 3.0 - 3.0 * x), 0.0, 1.0)
        angle_rad = theta * np.clip(6.0 * x - 3.0, -1.0, 1.0)
        return np.asarray(distance * np.exp(1j * angle_rad), dtype=np.complex128)

    return roots_within(delta, outside_the_cone) == 0


def roots_within(
    function: Callable[[ComplexArray], ComplexArray],
    contour: Callable[[FloatArray], ComplexArray],
) -> int:
    """Return how many zeros of an entire function a closed contour encloses, with multiplicity.

    ``contour`` maps [0, 1] to the contour, once around counterclockwise.
    """
    points = np.linspace(0.0, 1.0, _FIRST_POINTS)
    _, values = followed(lambda x: function(contour(x)), points)
    return round(float(np.sum(turns_rad(values))) / (2.0 * math.pi))


def _shifted(polynomial: Polynomial, sigma_1_s: float) -> Polynomial:
    """Return p(s - σ) as a polynomial in s, by Horner's rule."""
    shifted = np.array([0.0])
    for coefficient in polynomial:
        shifted = np.polyadd(np.polymul(shifted, [1.0, -sigma_1_s]), [coefficient])
    return shifted
