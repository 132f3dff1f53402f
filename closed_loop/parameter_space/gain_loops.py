"""Loops with a controller affine in its two gains, for the parameter space method.

    1 + P (K_p + K_d q) = 0      hence at a root s     K_p + K_d q(s) = -1/P(s)

``critical(s)`` is -1/P and ``derivative(s)`` is q, both at complex s [rad/s], for sampled loops at
z = e^(sT). Two kinds:

    ContinuousGainLoop    P(s), and q = s
    SampledGainLoop       the plant behind a delayed hold, and C(z) as
                          ``controller.laws.law_from_settings`` makes it from K_p, K_d and N: affine
                          in both gains too

-1/P is used and not P, because the vehicle's two integrators are poles of P at s = 0 and harmless
in 1/P.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import NamedTuple, Protocol

import numpy as np

from ...controller.analysis.linear_system import held_plant, polynomials
from ...controller.analysis.sampled_loop import SampledLoop
from ...controller.filters.discretization import design_pd
from ...controller.filters.settings import PdSettings
from ...controller.filters.transfer_function import TransferFunction
from ...controller.laws.law_from_settings import LawDesign
from ...controller.laws.pd import LAW as PD
from ...runtime.array_types import BoolArray, ComplexArray, FloatArray
from ...runtime.node import NS_PER_S
from .d_stability import DStability, in_s_plane, judge


class GainLine(NamedTuple):
    """The straight line constant + k_p K_p + k_d K_d = 0 in the plane of the gains."""

    constant: float
    k_p: float
    k_d: float


class GainLoop(Protocol):
    """What the parameter space method requires of a loop."""

    @property
    def omega_rad_s_max(self) -> float:
        """Upper bound of Im s: π/T of a sampled loop, else infinity [rad/s]."""

    @property
    def dead_time_s(self) -> float:
        """Upper bound of how fast P turns with ω [s]; it sets how boundaries are sampled."""

    def critical(self, s_rad_s: ComplexArray) -> ComplexArray:
        """Return -1/P at each s; not finite where P is zero."""

    def derivative(self, s_rad_s: ComplexArray) -> ComplexArray:
        """Return q at each s."""

    def satisfies(self, spec: DStability, gains: FloatArray) -> BoolArray:
        """Judge the roots at gains (K_p, K_d) of shape (n, 2)."""


class ContinuousGainLoop:
    """A plant from wheel angle [rad] to lateral error [m] under K_p + K_d s.

    Raises ValueError unless plant and controller together are strictly proper: then no root can
    pass through infinity.
    """

    omega_rad_s_max = math.inf
    dead_time_s = 0.0

    def __init__(self, model: TransferFunction) -> None:
        self._inverse = model.inverse()
        zeros, poles = polynomials(model)
        if len(poles) < len(zeros) + 2:
            raise ValueError("plant and controller together have to be strictly proper")
        parts = (poles, zeros, np.polymul(zeros, [1.0, 0.0]))
        self._characteristic = np.array(
            [np.pad(part, (len(poles) - len(part), 0)) for part in parts]
        )

    def critical(self, s_rad_s: ComplexArray) -> ComplexArray:
        """Return -1/P."""
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            return np.asarray(-self._inverse.response(s_rad_s), dtype=np.complex128)

    def derivative(self, s_rad_s: ComplexArray) -> ComplexArray:
        """Return s."""
        return s_rad_s

    def roots(self, gains: FloatArray) -> ComplexArray:
        """Return the roots s at each gain (K_p, K_d), shape (n, roots)."""
        coefficients = _with_one(gains) @ self._characteristic
        order = coefficients.shape[1] - 1
        companion = np.zeros((len(gains), order, order))
        companion[:] = np.eye(order, k=-1)
        companion[:, 0] = -coefficients[:, 1:] / coefficients[:, :1]
        return np.linalg.eigvals(companion).astype(np.complex128)

    def satisfies(self, spec: DStability, gains: FloatArray) -> BoolArray:
        """Judge the roots of the characteristic polynomial."""
        return judge(spec, self.roots(gains)).satisfied


class SampledGainLoop:
    """A plant behind a delayed hold under the discrete PD of ``controller.laws.law_from_settings``.

    ``model``                    continuous, from wheel angle [rad] to lateral error [m], strictly
                                 proper
    ``delay_ns``                 from command to wheel angle, constant, any ≥ 0
    ``derivative_filter_rad_s``  N; None for the ideal derivative: the backward difference
    """

    def __init__(
        self,
        model: TransferFunction,
        period_ns: int,
        delay_ns: int,
        derivative_filter_rad_s: float | None = None,
    ) -> None:
        self._period_ns = period_ns
        self._held = held_plant(model, period_ns, delay_ns)
        self.omega_rad_s_max = math.pi * NS_PER_S / period_ns
        self.dead_time_s = (delay_ns + period_ns) / NS_PER_S
        design = partial(_pd_design, derivative_filter_rad_s, period_ns / NS_PER_S)
        one, both, twice = design(1.0, 0.0), design(1.0, 1.0), design(2.0, 0.0)
        one_section, both_section = one.params.compensator, both.params.compensator
        self._q_numerator = np.array(both_section[:3]) - np.array(one_section[:3])
        self._q_denominator = np.array([1.0, *one_section[3:]])
        loops = [SampledLoop(law, model, period_ns) for law in (one, both, twice)]
        self._matrices = affine_in_gains(loops, delay_ns)

    def critical(self, s_rad_s: ComplexArray) -> ComplexArray:
        """Return -1/P(z): minus the input that makes the output 1."""
        z = self._z(s_rad_s)
        order = len(self._held.c)
        system = np.zeros((*z.shape, order + 1, order + 1), dtype=np.complex128)
        system[..., :order, :order] = z[..., None, None] * np.eye(order) - self._held.a
        inputs = self._held.b_new + self._held.b_old / z[..., None]
        system[..., :order, order] = -inputs
        system[..., order, :order] = self._held.c
        output = np.zeros((order + 1, 1))
        output[order] = 1.0
        inverse = np.linalg.solve(system, output)[..., order, 0]
        return np.asarray(-inverse * z ** float(self._held.whole_periods), dtype=np.complex128)

    def derivative(self, s_rad_s: ComplexArray) -> ComplexArray:
        """Return q(z) of the design."""
        z = self._z(s_rad_s)
        with np.errstate(divide="ignore", invalid="ignore"):
            quotient = np.polyval(self._q_numerator, z) / np.polyval(self._q_denominator, z)
        return np.asarray(quotient, dtype=np.complex128)

    def roots(self, gains: FloatArray) -> ComplexArray:
        """Return the roots s = ln(z)/T at each gain (K_p, K_d), shape (n, roots)."""
        return roots_of_affine(self._matrices, gains, self._period_ns)

    def satisfies(self, spec: DStability, gains: FloatArray) -> BoolArray:
        """Judge the eigenvalues of the closed loop."""
        return judge(spec, self.roots(gains)).satisfied

    def _z(self, s_rad_s: ComplexArray) -> ComplexArray:
        return np.asarray(np.exp(s_rad_s * (self._period_ns / NS_PER_S)), dtype=np.complex128)


def affine_in_gains(loops: Sequence[SampledLoop], delay_ns: int) -> FloatArray:
    """Return M_0, M_p and M_d of the state matrix M_0 + K_p M_p + K_d M_d, shape (3, n, n).

    ``loops`` are those at the gains (1, 0), (1, 1) and (2, 0): three loops determine an affine
    matrix, and the settings require K_p > 0.
    """
    one, both, twice = (loop.closed_loop_matrix(delay_ns) for loop in loops)
    return np.array([2.0 * one - twice, twice - one, both - one])


def roots_of_affine(matrices: FloatArray, gains: FloatArray, period_ns: int) -> ComplexArray:
    """Return the roots s of M_0 + K_p M_p + K_d M_d at each gain (K_p, K_d), shape (n, roots)."""
    closed = np.tensordot(_with_one(gains), matrices, axes=1)
    return in_s_plane(np.linalg.eigvals(closed).astype(np.complex128), period_ns)


def _pd_design(
    derivative_filter_rad_s: float | None, period_s: float, k_p: float, k_d: float
) -> LawDesign:
    settings = PdSettings(
        proportional_gain_rad_m=k_p,
        derivative_gain_rad_s_m=k_d,
        derivative_filter_rad_s=derivative_filter_rad_s,
    )
    params = design_pd(settings, period_s)
    return LawDesign(params, partial(PD.at_rest, params), PD.step)


def _with_one(gains: FloatArray) -> FloatArray:
    return np.column_stack([np.ones(len(gains)), gains])
