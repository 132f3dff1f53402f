"""Number of roots of a loop with an exact delay in the right half-plane: argument principle.

    Δ(s) = p(s) + q(s) e^(-sT),   deg q < deg p = n,   real coefficients

Cleared of denominators Δ is entire, so its argument along the imaginary axis counts its zeros to
the right, and there is no pole on the axis that would need an indentation:

    Z = n/2 - (arg Δ(jω) from ω = 0 to ∞)/π

e^(-jωT) is evaluated exactly; a Padé approximation has other roots. Powers of s common to p and q
are taken out first and reported: roots at s = 0 that no delay and no gain moves.
"""

from collections.abc import Callable
from functools import reduce
from typing import NamedTuple

import numpy as np

from ...runtime.array_types import ComplexArray, FloatArray

Polynomial = FloatArray
"""Real coefficients, highest power first."""

_LARGEST_TURN_RAD = 0.3
_HALVINGS_MAX = 40
_LOGARITHMIC_POINTS = 4000
_POINTS_PER_RAD = 8.0


class RootCount(NamedTuple):
    """Where the roots of a loop lie.

    ``right``      in the open right half-plane
    ``at_origin``  at s = 0 exactly, from cancelled integrators: they integrate their input, and the
                   feedback does not see it
    ``clearance``  smallest |Δ|/(|p| + |q|) on the imaginary axis, from 0 to 1; at 0 a root lies on
                   the axis and ``right`` is meaningless
    """

    right: int
    at_origin: int
    clearance: float

    @property
    def stable(self) -> bool:
        """Whether every root has a negative real part."""
        return self.right == 0 and self.at_origin == 0


def on_axis(omega_rad_s: FloatArray) -> ComplexArray:
    """Return s = jω."""
    return np.asarray(1j * omega_rad_s, np.complex128)


def count_roots(undelayed: Polynomial, delayed: Polynomial, delay_s: float) -> RootCount:
    """Return where the roots of p + q e^(-sT) lie, T ≥ 0.

    ``undelayed`` is p and ``delayed`` q. Raises ValueError unless deg q < deg p: otherwise the loop
    responds at once (neutral), and infinitely many roots may lie to the right.
    """
    p, q, at_origin = _without_common_powers(undelayed, delayed)
    if len(q) >= len(p):
        raise ValueError("the loop has to be strictly proper")
    omega_rad_s, values, turned_rad = followed(
        lambda omega_rad_s: _values(p, q, delay_s, omega_rad_s), _initial_points(p, q, delay_s)
    )
    order = len(p) - 1
    leading = p[0] * (1j * omega_rad_s[-1]) ** order
    change_rad = turned_rad - float(np.angle(values[-1] / leading))
    s = on_axis(omega_rad_s)
    size = np.abs(np.polyval(p, s)) + np.abs(np.polyval(q, s))
    return RootCount(
        right=round(order / 2.0 - change_rad / np.pi),
        at_origin=at_origin,
        clearance=float(np.min(np.abs(values) / size)),
    )


def _without_common_powers(
    undelayed: Polynomial, delayed: Polynomial
) -> tuple[Polynomial, Polynomial, int]:
    """Return p and q without leading zeros and without the powers of s they share."""
    p, q = np.trim_zeros(undelayed, "f"), np.trim_zeros(delayed, "f")
    common = min(len(poly) - len(np.trim_zeros(poly, "b")) for poly in (p, q))
    return p[: len(p) - common], q[: len(q) - common], common


def _initial_points(p: Polynomial, q: Polynomial, delay_s: float) -> FloatArray:
    """Return ω from 0 to where p[0] s^n stays more than twice all other terms [rad/s].

    The argument beyond the last point follows from _values divided by the leading term there. The
    points are so dense that neither the polynomials nor e^(-jωT) can turn unnoticed between them.
    """
    others = np.abs(p)
    others[0] = 0.0
    others[len(p) - len(q) :] += np.abs(q)
    last_rad_s, sizes = 1.0, others.tolist()
    while _at(sizes, last_rad_s) > 0.5 * abs(p[0]) * last_rad_s ** (len(p) - 1):
        last_rad_s *= 1.5
    logarithmic = np.geomspace(1e-6 * last_rad_s, last_rad_s, _LOGARITHMIC_POINTS)
    turns = 1 + int(_POINTS_PER_RAD * last_rad_s * delay_s)
    return np.union1d(logarithmic, np.linspace(0.0, last_rad_s, turns + 1))


def _at(coefficients: list[float], omega_rad_s: float) -> float:
    """Return a polynomial at one point."""
    return reduce(lambda value, each: value * omega_rad_s + each, coefficients)


def _values(p: Polynomial, q: Polynomial, delay_s: float, omega_rad_s: FloatArray) -> ComplexArray:
    """Return Δ(jω)."""
    s = on_axis(omega_rad_s)
    return np.asarray(np.polyval(p, s) + np.polyval(q, s) * np.exp(-s * delay_s), np.complex128)


def followed(
    values_at: Callable[[FloatArray], ComplexArray], points: FloatArray
) -> tuple[FloatArray, ComplexArray, float]:
    """Return points and values, halved where the argument turns too far, and all turns [rad]."""
    values = values_at(points)
    turns_rad = _turns_rad(values[:-1], values[1:])
    for _ in range(_HALVINGS_MAX):
        coarse = np.flatnonzero(np.abs(turns_rad) > _LARGEST_TURN_RAD)
        if not len(coarse):
            break
        middles = 0.5 * (points[coarse] + points[coarse + 1])
        points = np.insert(points, coarse + 1, middles)
        values = np.insert(values, coarse + 1, values_at(middles))
        before, middle = coarse + np.arange(len(coarse)), coarse + np.arange(1, len(coarse) + 1)
        turns_rad = np.insert(turns_rad, coarse + 1, _turns_rad(values[middle], values[middle + 1]))
        turns_rad[before] = _turns_rad(values[before], values[middle])
    return points, values, float(np.sum(turns_rad))


def _turns_rad(values: ComplexArray, next_values: ComplexArray) -> FloatArray:
    """Return the angle from each value to the next, within ±π [rad]."""
    return np.angle(next_values * np.conj(values))
