"""Counts the growing modes of the sampled loop at any constant delay.

With plant (A, b, c) behind a hold delayed by τ = n T + ε and the law F(z), the loop's poles are the
zeros of

    χ(z) = q(z) - p_ε(z) z^(-n)          q = det(zI - A_plant) det(zI - A_law), of degree d
                                         p = q F c (zI - A)⁻¹ (b_new(ε) + b_old(ε)/z)

Argument principle: χ has d zeros outside |z| = ρ less the turns it makes about 0 as z goes once
round that circle. Only z^(-n) depends on the whole periods, so that q and p are computed once for
all delays: the problem has the order of law and plant, however many commands are in transit.

ρ = exp(-SLOWEST_DECAY_1_S T): a mode that decays more slowly counts as growing.
"""

import math

import numpy as np

from ...runtime.array_types import ComplexArray, FloatArray
from ...runtime.node import NS_PER_S
from .linear_system import output_rows, triangular
from .sampled_loop import SLOWEST_DECAY_1_S, SampledLoop

_PHASE_STEP_RAD = 1.0
"""Where χ turns by more between two points of the circle, points are added between them."""
_REFINEMENTS_MAX = 40
"""Ends the adding of points where a mode lies on the circle itself."""
_SLOW_RAD_S_MIN = 1e-5
_RATIO = 1.02


class GrowingModes:
    """The modes of one loop outside |z| = ρ, at any constant delay up to ``delay_ns_max`` [ns]."""

    def __init__(self, loop: SampledLoop, delay_ns_max: int) -> None:
        self._law, self._loop = triangular(loop.law), loop
        self._degree = len(self._law.b) + len(loop.plant(0).a)
        self._log_radius = -SLOWEST_DECAY_1_S * loop.period_ns / NS_PER_S
        self._theta = self._grid(delay_ns_max / loop.period_ns)
        self._q, self._p = self._polynomials(self._theta)

    def count(self, delay_ns: int) -> int:
        """Return how many modes grow, or hardly decay, at a constant delay up to the limit.

        A complex pair counts twice.
        """
        theta, chi = self._theta, self._chi(self._theta, self._q, self._p, delay_ns)
        for _ in range(_REFINEMENTS_MAX):
            turns_rad = np.angle(chi[1:] * chi[:-1].conj())
            wide = np.flatnonzero(np.abs(turns_rad) > _PHASE_STEP_RAD)
            if not len(wide):
                break
            between = 0.5 * (theta[wide] + theta[wide + 1])
            values = self._chi(between, *self._polynomials(between), delay_ns)
            theta = np.insert(theta, wide + 1, between)
            chi = np.insert(chi, wide + 1, values)
        turns_rad = np.angle(chi[1:] * chi[:-1].conj())
        return self._degree - round(float(turns_rad.sum()) / math.pi)

    def _grid(self, whole_periods: float) -> FloatArray:
        """Return angles from 0 to π.

        They are dense enough for z^(-n) everywhere. Towards 0 they lie in small ratios, so that the
        modes of a slow law, all of them close to z = 1, together do not turn χ by more than
        _PHASE_STEP_RAD.
        """
        points = math.ceil(2.0 * math.pi * (whole_periods + self._degree))
        slowest = _SLOW_RAD_S_MIN * self._loop.period_ns / NS_PER_S
        slow = slowest * _RATIO ** np.arange(math.log(math.pi / slowest) / math.log(_RATIO))
        return np.union1d(slow, np.linspace(0.0, math.pi, points + 1))

    def _polynomials(self, theta: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        """Return q, shape (points,), and the factors of p, shape (points, plant order)."""
        z, plant = np.exp(self._log_radius + 1j * theta), self._loop.plant(0)
        of_plant = np.linalg.det(z[:, None, None] * np.eye(len(plant.a)) - plant.a)
        q = of_plant * self._law.determinant(z)
        return q, np.einsum("iz,izn->zn", q * self._law.response(z), output_rows(plant, z))

    def _chi(
        self, theta: FloatArray, q: ComplexArray, p: ComplexArray, delay_ns: int
    ) -> ComplexArray:
        log_z = self._log_radius + 1j * theta
        whole_periods, rest_ns = divmod(delay_ns, self._loop.period_ns)
        plant = self._loop.plant(rest_ns)  # a scan has the same rest again and again
        newer, older = _times(p, plant.b_new), _times(p, plant.b_old)
        return np.asarray(
            q
            - newer * np.exp(-whole_periods * log_z)
            - older * np.exp(-(whole_periods + 1) * log_z)
        )


def _times(rows: ComplexArray, vector: FloatArray) -> ComplexArray:
    """Return ``rows @ vector`` on one thread: numpy would use several, which is slower here."""
    return np.asarray(np.einsum("ij,j->i", rows, vector), dtype=np.complex128)
