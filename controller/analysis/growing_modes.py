"""Growing modes of the sampled loop: their number, and the delays at which they begin to grow.

With plant (A, b, c) behind a hold delayed by τ = n T + ε and the law F(z), the loop's poles are the
zeros of

    χ(z) = q(z) - p_ε(z) z^(-n)          q = det(zI - A_plant) det(zI - A_law), of degree d
                                         p = q F c (zI - A)⁻¹ (b_new(ε) + b_old(ε)/z)

Argument principle: χ has d zeros outside |z| = ρ less the turns it makes about 0 as z goes once
round that circle. Only z^(-n) depends on the whole periods, so that q and p are computed once for
all delays: the problem has the order of law and plant, however many commands are in transit.

Direct method (Walton and Marshall 1987, for continuous loops): as the delay grows, a mode can begin
or cease to grow only where a zero crosses the circle,

    log r(θ, ε) - (τ/T) log z = 2πj k,     z = ρ exp(jθ),   r = p/q z^(ε/T)

r hardly depends on ε below Nyquist, so that |r| is 1 at a few θ, and each θ has its delays
τ = (arg r + 2πk) T/θ. They serve as starting points; Newton's method solves the equation itself.
The list of crossings gives the delays to examine, so that no change is missed because it is shorter
than the step of a scan. The stability between crossings is decided by counting.

ρ = exp(-SLOWEST_DECAY_1_S T): a mode that decays more slowly counts as growing.
"""

import math

import numpy as np

from ...runtime.array_types import ComplexArray, FloatArray
from ...runtime.node import NS_PER_S
from ..matrices import zero_order_hold
from .linear_system import companion_form, output_rows, triangular
from .sampled_loop import SLOWEST_DECAY_1_S, SampledLoop

_PHASE_STEP_RAD = 1.0
"""Where χ turns by more between two points of the circle, points are added between them."""
_REFINEMENTS_MAX = 40
"""Ends the adding of points where a mode lies on the circle itself."""
_SLOW_RAD_S_MIN = 1e-5
_RATIO = 1.02
_PARTS_OF_PERIOD = 8
_NEWTON_STEPS = 6
_THETA_STEP = 1e-7
_RESIDUAL_MAX = 1e-8


class GrowingModes:
    """The modes of one loop outside |z| = ρ, at any constant delay up to ``delay_ns_max`` [ns]."""

    def __init__(self, loop: SampledLoop, delay_ns_max: int) -> None:
        self._law, self._loop = triangular(loop.law), loop
        self._a, self._b, _ = companion_form(loop.model, len(loop.law.d))
        self._whole = self._held_for(loop.period_ns / NS_PER_S)
        self._delay_ns_max = delay_ns_max
        self._degree = len(self._law.b) + len(self._b)
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

    def crossings_ns(self) -> FloatArray:
        """Return the delays at which a mode begins or ceases to grow, ascending [ns]."""
        theta, delay_ns = self._first_guesses()
        inside = np.ones(len(theta), dtype=bool)
        for _ in range(_NEWTON_STEPS):
            residual, by_theta, by_delay = self._crossing_residual(theta, delay_ns)
            determinant = by_theta.real * by_delay.imag - by_theta.imag * by_delay.real
            determinant[determinant == 0.0] = math.inf
            d_theta = residual.real * by_delay.imag - residual.imag * by_delay.real
            d_delay = by_theta.real * residual.imag - by_theta.imag * residual.real
            theta = theta - d_theta / determinant
            delay_ns = delay_ns - d_delay / determinant
            inside = (theta > 0.0) & (theta <= math.pi)
            inside &= (delay_ns >= 0.0) & (delay_ns <= self._delay_ns_max)
            theta, delay_ns = theta[inside], delay_ns[inside]
        residual, _, _ = self._crossing_residual(theta, delay_ns)
        return np.unique(np.round(delay_ns[np.abs(residual) < _RESIDUAL_MAX]))

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

    def _z(self, theta: FloatArray) -> ComplexArray:
        return np.asarray(np.exp(self._log_radius + 1j * theta), dtype=np.complex128)

    def _polynomials(self, theta: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        """Return q, shape (points,), and the factors of p, shape (points, plant order)."""
        z, plant = self._z(theta), self._loop.plant(0)
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

    def _held_for(self, time_s: float | FloatArray) -> FloatArray:
        """Return what a unit command adds to the plant's state in some time."""
        return zero_order_hold(self._a, self._b, time_s)[1]

    def _first_guesses(self) -> tuple[FloatArray, FloatArray]:
        """Return angles and delays [ns] near the crossings, shape (guesses,) each."""
        period_s = self._loop.period_ns / NS_PER_S
        theta, gain = self._theta[1:], self._p[1:] / self._q[1:, None]
        log_z = self._log_radius + 1j * theta
        guesses: list[tuple[FloatArray, FloatArray]] = []
        for part in range(_PARTS_OF_PERIOD):
            share = part / _PARTS_OF_PERIOD
            new = self._held_for((1.0 - share) * period_s)
            older = _times(gain, self._whole - new)
            r = (_times(gain, new) + older * np.exp(-log_z)) * np.exp(share * log_z)
            log_modulus, phase = np.log(np.abs(r)), np.unwrap(np.angle(r))
            at = np.flatnonzero(np.signbit(log_modulus[:-1]) != np.signbit(log_modulus[1:]))
            along = log_modulus[at] / (log_modulus[at] - log_modulus[at + 1])
            theta_at = theta[at] + along * (theta[at + 1] - theta[at])
            phase_at = phase[at] + along * (phase[at + 1] - phase[at])
            for angle, turned in zip(theta_at, phase_at, strict=True):
                last = angle * (self._delay_ns_max / self._loop.period_ns + 1.0)
                k = np.arange(math.ceil(-turned / math.tau), (last - turned) / math.tau)
                periods = (turned + math.tau * k) / angle
                off = np.abs((periods - share + 0.5) % 1.0 - 0.5)
                near = periods[off <= 0.75 / _PARTS_OF_PERIOD]
                guesses.append((np.full(len(near), angle), near * self._loop.period_ns))
        if not guesses:
            return np.zeros(0), np.zeros(0)
        return np.concatenate([g[0] for g in guesses]), np.concatenate([g[1] for g in guesses])

    def _crossing_residual(
        self, theta: FloatArray, delay_ns: FloatArray
    ) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        """Return log(p z^(-n) / q), mod 2πj, and its derivatives by angle and by delay [1/ns]."""
        periods, rest_ns = np.divmod(delay_ns, self._loop.period_ns)
        new_s = (self._loop.period_ns - rest_ns) / NS_PER_S
        new = self._held_for(new_s)
        rate = new @ self._a.T + self._b  # d(new)/d(new_s)
        old = self._whole - new

        def transfer(angle: FloatArray) -> tuple[ComplexArray, ComplexArray]:
            z = self._z(angle)
            q, p = self._polynomials(angle)
            delayed = p / q[:, None] * (z ** (-periods))[:, None]
            value = np.sum(delayed * (new + old / z[:, None]), axis=1)
            by_delay = np.sum(delayed * rate, axis=1) * (1.0 / z - 1.0) / NS_PER_S
            return value, by_delay

        value, by_delay = transfer(theta)
        further, _ = transfer(theta + _THETA_STEP)
        by_theta = np.asarray(np.log(further / value) / _THETA_STEP, dtype=np.complex128)
        return np.asarray(np.log(value), dtype=np.complex128), by_theta, by_delay / value


def _times(rows: ComplexArray, vector: FloatArray) -> ComplexArray:
    """Return ``rows @ vector`` on one thread: numpy would use several, which is slower here."""
    return np.asarray(np.einsum("ij,j->i", rows, vector), dtype=np.complex128)
