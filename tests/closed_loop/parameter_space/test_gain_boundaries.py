"""Boundaries in the plane of the gains: closed forms, and roots where they should be."""

import math
from collections.abc import Callable

import numpy as np

from steer_by_wire.closed_loop.parameter_space.d_stability import d_stability
from steer_by_wire.closed_loop.parameter_space.gain_boundaries import (
    Bound,
    RootKind,
    Window,
    boundary_curves,
)
from steer_by_wire.closed_loop.parameter_space.gain_loops import ContinuousGainLoop
from steer_by_wire.runtime.array_types import FloatArray
from tests.support.loops.gain_loops import (
    DOUBLE_INTEGRATOR,
    LOOPS,
    SPEC,
    WINDOW,
)

# Closed form: 1/s² with a PD has the roots of s² + K_d s + K_p


def test_the_boundaries_of_a_double_integrator_are_those_computed_by_hand() -> None:
    spec = d_stability(0.3, 120.0, 1.3)
    sigma, radius = spec.sigma_1_s, spec.radius_rad_s
    zero_on: dict[tuple[Bound, RootKind], Callable[[FloatArray], FloatArray]] = {
        (Bound.SIGMA, RootKind.COMPLEX): lambda k: k[:, 1] - 2.0 * sigma,
        (Bound.SIGMA, RootKind.REAL): lambda k: k[:, 0] - sigma * k[:, 1] + sigma**2,
        (Bound.CONE, RootKind.COMPLEX): lambda k: k[:, 1] - np.sqrt(k[:, 0]),  # ζ = 1/2
        (Bound.RADIUS, RootKind.COMPLEX): lambda k: k[:, 0] - radius**2,
        (Bound.RADIUS, RootKind.REAL): lambda k: k[:, 0] - radius * k[:, 1] + radius**2,
    }
    loop = ContinuousGainLoop(DOUBLE_INTEGRATOR)
    curves = boundary_curves(loop, spec, Window(-1, 3, -1, 4))
    assert {(curve.bound, curve.kind) for curve in curves} == set(zero_on)
    for curve in curves:
        off = zero_on[curve.bound, curve.kind](curve.gains)
        assert np.max(np.abs(off)) < 1e-9
    ends = {curve.bound: curve.gains for curve in curves if curve.kind is RootKind.COMPLEX}
    np.testing.assert_allclose(ends[Bound.SIGMA][0], [sigma**2, 2.0 * sigma], rtol=1e-9)
    np.testing.assert_allclose(ends[Bound.RADIUS][0], [radius**2, 2.0 * radius], rtol=1e-9)


# Boundaries are where roots are


def test_the_real_root_boundary_at_the_end_of_the_strip_is_the_one_computed_by_hand() -> None:
    """1/s held, h = 10 ms: z (z - 1) + (h K_p + K_d) z - K_d = 0, here at z = -e^(-σh)."""
    curves = boundary_curves(LOOPS["sampled integrator"], SPEC, WINDOW)
    (line,) = (curve for curve in curves if curve.s_rad_s[0].imag == curve.s_rad_s[1].imag > 0.0)
    assert (line.bound, line.kind) == (Bound.SIGMA, RootKind.REAL)
    k_p, k_d = line.gains.T
    z = -math.exp(-SPEC.sigma_1_s * 0.01)
    np.testing.assert_allclose(z * (z - 1.0) + (0.01 * k_p + k_d) * z - k_d, 0.0, atol=1e-12)
