"""Continuous-time transfer functions as products of factors, for design time.

    F(s) = s^k · Π numerator factors / Π denominator factors,   factor = s2·s² + s1·s + s0

The power of s is an exact integer k, so the two integrators of the vehicle cancel the washout
(s/(s + ω_h))² in integer arithmetic. No nearly cancelled pole-zero pair at s = 0 is left, which
rounding could make unstable. Factors stay factors: nothing is multiplied out and no roots are
searched, so a filter's sections get exactly the coefficients they were designed with.
"""

from __future__ import annotations

from itertools import zip_longest
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Factor(NamedTuple):
    """Polynomial s2·s² + s1·s + s0 of degree 2 at most, s0 ≠ 0 (powers of s are kept apart)."""

    s2: float
    s1: float
    s0: float

    @property
    def degree(self) -> int:
        """Highest power of s with a non-zero coefficient."""
        return 2 if self.s2 else 1 if self.s1 else 0

    def at(self, s_rad_s: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Return the polynomial at complex s [rad/s], same shape."""
        return ((self.s2 * s_rad_s + self.s1) if self.s2 else self.s1) * s_rad_s + self.s0

    @property
    def hurwitz(self) -> bool:
        """Whether every root lies in the open left half-plane (degree ≤ 2: all signs equal)."""
        used = (self.s2, self.s1, self.s0)[2 - self.degree :]
        return all(c > 0.0 for c in used) or all(c < 0.0 for c in used)


class TransferFunction(NamedTuple):
    """s^power_of_s · Π numerator / Π denominator; a negative power counts integrators.

    ``heading``  numerator of a second output, the heading error, over the same denominator and
                 integrators; empty where it is not known
    """

    power_of_s: int
    numerator: tuple[Factor, ...]
    denominator: tuple[Factor, ...]
    heading: tuple[Factor, ...] = ()

    def times(self, other: TransferFunction) -> TransferFunction:
        """Return the series connection of both."""
        return TransferFunction(
            self.power_of_s + other.power_of_s,
            self.numerator + other.numerator,
            self.denominator + other.denominator,
            self.heading and self.heading + other.numerator,
        )

    def inverse(self) -> TransferFunction:
        """Return 1/F(s), improper where F is strictly proper."""
        return TransferFunction(-self.power_of_s, self.denominator, self.numerator)

    def response(self, s_rad_s: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Return F at complex s [rad/s], same shape; s = 0 only if power_of_s ≥ 0."""
        value = s_rad_s ** float(self.power_of_s)
        for factor in self.numerator:
            value = value * factor.at(s_rad_s)
        for factor in self.denominator:
            value = value / factor.at(s_rad_s)
        return value

    def biquads(self) -> tuple[tuple[Factor, Factor], ...]:
        """Return proper (numerator, denominator) pairs of degree ≤ 2 whose product is F(s).

        s² is one of the factors, paired with the first denominator. Raises ValueError if F cannot
        be split in this way: an odd power of s, or a section whose numerator has a higher degree.
        """
        one, s_squared = Factor(0.0, 0.0, 1.0), Factor(1.0, 0.0, 0.0)
        if self.power_of_s % 2:
            raise ValueError(f"s^{self.power_of_s} does not split into quadratic factors")
        zeros = (s_squared,) * max(0, self.power_of_s // 2) + self.numerator
        poles = (s_squared,) * max(0, -self.power_of_s // 2) + self.denominator
        zeros = tuple(sorted(zeros, key=lambda factor: -factor.degree))
        poles = tuple(sorted(poles, key=lambda factor: -factor.degree))
        pairs = tuple(zip_longest(zeros, poles, fillvalue=one))
        if any(numerator.degree > denominator.degree for numerator, denominator in pairs):
            raise ValueError("the transfer function does not split into proper sections")
        return pairs
