"""Loop with a controller affine in its two gains, for the parameter space method.

    1 + P (K_p + K_d s) = 0      hence at a root s     K_p + K_d s = -1/P(s)

-1/P is used and not P, because the vehicle's two integrators are poles of P at s = 0 and harmless
in 1/P.
"""

import numpy as np

from ...controller.analysis.linear_system import polynomials
from ...controller.filters.transfer_function import TransferFunction
from ...runtime.array_types import BoolArray, ComplexArray, FloatArray
from .d_stability import DStability, judge


class GainLoop:
    """A plant from wheel angle [rad] to lateral error [m] under K_p + K_d s, without delay.

    Raises ValueError unless plant and controller together are strictly proper: then no root can
    pass through infinity.
    """

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
        """Return -1/P at each s; not finite where P is zero."""
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            return np.asarray(-self._inverse.response(s_rad_s), dtype=np.complex128)

    def roots(self, gains: FloatArray) -> ComplexArray:
        """Return the roots s at each gain (K_p, K_d), shape (n, roots)."""
        coefficients = np.column_stack([np.ones(len(gains)), gains]) @ self._characteristic
        order = coefficients.shape[1] - 1
        companion = np.zeros((len(gains), order, order))
        companion[:] = np.eye(order, k=-1)
        companion[:, 0] = -coefficients[:, 1:] / coefficients[:, :1]
        return np.linalg.eigvals(companion).astype(np.complex128)

    def satisfies(self, spec: DStability, gains: FloatArray) -> BoolArray:
        """Judge the roots at gains (K_p, K_d) of shape (n, 2)."""
        return judge(spec, self.roots(gains)).satisfied
