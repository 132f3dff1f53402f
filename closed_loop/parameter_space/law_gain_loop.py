"""The gains of the PD inside any law: the loop with DOB and CDOB, for the parameter space method.

The observers do not depend on K_p and K_d, and the PD acts on one signal, the error fed back. So
the state matrix of the closed loop is M_0 + (K_p c_p + K_d c_d) rᵀ with fixed vectors, and a root z
is where

    K_p P_p + K_d P_d = 1,     P_p = rᵀ (zI - M_0)⁻¹ c_p,     P_d = rᵀ (zI - M_0)⁻¹ c_d

That is K_p + K_d q = -1/P of ``closed_loop.parameter_space.gain_loops``, with -1/P = 1/P_p, q =
P_d/P_p.
"""

import math

import numpy as np

from ...controller.analysis.sampled_loop import SampledLoop
from ...controller.filters.transfer_function import TransferFunction
from ...controller.laws.design import design_law, required
from ...controller.laws.settings import LawSettings
from ...runtime.array_types import BoolArray, ComplexArray, FloatArray
from ...runtime.node import NS_PER_S
from .d_stability import DStability, judge
from .gain_loops import GainLine, affine_in_gains, roots_of_affine


class LawGainLoop:
    """A law around a plant behind a delayed hold; the gains of ``settings.pd`` do not matter.

    ``model``      of the plant, from wheel angle [rad] to lateral error [m], strictly proper; the
                   observers have their own, in the settings
    ``period_ns``  of the control ticks, the one of the settings' rate
    ``delay_ns``   from command to wheel angle, constant, any ≥ 0
    """

    def __init__(
        self, settings: LawSettings, model: TransferFunction, period_ns: int, delay_ns: int
    ) -> None:
        def loop(k_p: float, k_d: float) -> SampledLoop:
            gains = {"proportional_gain_rad_m": k_p, "derivative_gain_rad_s_m": k_d}
            pd = required(settings.pd).model_copy(update=gains)
            return SampledLoop(design_law(settings.model_copy(update={"pd": pd})), model, period_ns)

        self._period_ns = period_ns
        self.omega_rad_s_max = math.pi * NS_PER_S / period_ns
        self.dead_time_s = (delay_ns + period_ns) / NS_PER_S
        self._matrices = affine_in_gains((loop(1.0, 0.0), loop(1.0, 1.0), loop(2.0, 0.0)), delay_ns)
        _, _, rows = np.linalg.svd(np.concatenate(self._matrices[1:]))
        self._fed_back = rows[0]  # r: the rows of both matrices are multiples of one
        self._columns = self._matrices[1:] @ self._fed_back

    def critical(self, s_rad_s: ComplexArray) -> ComplexArray:
        """Return 1/P_p."""
        return self._solved(s_rad_s)[..., 0]

    def derivative(self, s_rad_s: ComplexArray) -> ComplexArray:
        """Return P_d/P_p."""
        return self._solved(s_rad_s)[..., 1]

    def infinite_root_line(self) -> GainLine | None:
        """Return None: the state matrix is finite at any gains."""
        return None

    def roots(self, gains: FloatArray) -> ComplexArray:
        """Return the roots s = ln(z)/T at each gain (K_p, K_d), shape (n, roots)."""
        return roots_of_affine(self._matrices, gains, self._period_ns)

    def satisfies(self, spec: DStability, gains: FloatArray) -> BoolArray:
        """Judge the eigenvalues of the closed loop."""
        return judge(spec, self.roots(gains)).satisfied

    def _solved(self, s_rad_s: ComplexArray) -> ComplexArray:
        """Return 1/P_p and P_d/P_p, shape (..., 2), also at poles of P_p.

        First the input u that keeps rᵀx = 1, then the one that keeps rᵀx = 0 against c_d.
        """
        z = np.exp(s_rad_s * (self._period_ns / NS_PER_S))
        order = len(self._fed_back)
        system = np.zeros((*z.shape, order + 1, order + 1), dtype=np.complex128)
        system[..., :order, :order] = z[..., None, None] * np.eye(order) - self._matrices[0]
        system[..., :order, order] = -self._columns[0]
        system[..., order, :order] = self._fed_back
        wanted = np.zeros((order + 1, 2))
        wanted[order, 0] = 1.0
        wanted[:order, 1] = self._columns[1]
        inputs = np.linalg.solve(system, wanted)[..., order, :]
        return np.asarray(inputs * [1.0, -1.0], dtype=np.complex128)
