"""Boundaries in the plane of the gains: closed forms, and roots where they should be."""

from collections.abc import Callable

import numpy as np

from steer_by_wire.closed_loop.parameter_space.d_stability import d_stability
from steer_by_wire.closed_loop.parameter_space.gain_boundaries import (
    Bound,
    RootKind,
    Window,
    boundary_curves,
)
from steer_by_wire.closed_loop.parameter_space.gain_loop import GainLoop
from steer_by_wire.runtime.array_types import FloatArray
from tests.support.loops.gain_loops import (
    DOUBLE_INTEGRATOR,
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
    loop = GainLoop(DOUBLE_INTEGRATOR)
    curves = boundary_curves(loop, spec, Window(-1, 3, -1, 4))
    assert {(curve.bound, curve.kind) for curve in curves} == set(zero_on)
    for curve in curves:
        off = zero_on[curve.bound, curve.kind](curve.gains)
        assert np.max(np.abs(off)) < 1e-9
    ends = {curve.bound: curve.gains for curve in curves if curve.kind is RootKind.COMPLEX}
    np.testing.assert_allclose(ends[Bound.SIGMA][0], [sigma**2, 2.0 * sigma], rtol=1e-9)
    np.testing.assert_allclose(ends[Bound.RADIUS][0], [radius**2, 2.0 * radius], rtol=1e-9)
