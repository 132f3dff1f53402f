"""Boundaries in the plane of the gains: closed forms, and roots where they should be."""

from collections.abc import Callable

import numpy as np
import pytest

from steer_by_wire.closed_loop.parameter_space.d_stability import (
    DStability,
    d_stability,
    paper_d_stability,
)
from steer_by_wire.closed_loop.parameter_space.gain_boundaries import (
    Bound,
    RootKind,
    boundary_curves,
    closed_loop_roots,
)
from steer_by_wire.controller.filters.nominal_model import paper_eq19, steer_to_lateral_error
from steer_by_wire.controller.filters.transfer_function import Factor, TransferFunction
from steer_by_wire.runtime.array_types import FloatArray
from steer_by_wire.tools.paper.corners import corner_vehicles

DOUBLE_INTEGRATOR = TransferFunction(-2, (Factor(0.0, 0.0, 1.0),), ())
LEAD = TransferFunction(0, (Factor(0.0, 1.0, 2.0),), (Factor(1.0, 1.0, 1.0),))  # (s+2)/(s²+s+1)
PLANTS = (paper_eq19(), *map(steer_to_lateral_error, corner_vehicles()))


def test_the_boundaries_of_a_double_integrator_are_those_computed_by_hand() -> None:
    """1/s² with a PD has the roots of s² + K_d s + K_p."""
    spec = d_stability(0.3, 120.0, 1.3)
    sigma, radius = spec.sigma_1_s, spec.radius_rad_s
    zero_on: dict[tuple[Bound, RootKind], Callable[[FloatArray], FloatArray]] = {
        (Bound.SIGMA, RootKind.COMPLEX): lambda k: k[:, 1] - 2.0 * sigma,
        (Bound.SIGMA, RootKind.REAL): lambda k: k[:, 0] - sigma * k[:, 1] + sigma**2,
        (Bound.CONE, RootKind.COMPLEX): lambda k: k[:, 1] - np.sqrt(k[:, 0]),  # ζ = 1/2
        (Bound.RADIUS, RootKind.COMPLEX): lambda k: k[:, 0] - radius**2,
        (Bound.RADIUS, RootKind.REAL): lambda k: k[:, 0] - radius * k[:, 1] + radius**2,
    }
    curves = boundary_curves(DOUBLE_INTEGRATOR, spec, (-1.0, 4.0))
    assert {(curve.bound, curve.kind) for curve in curves} == set(zero_on)
    for curve in curves:
        off = zero_on[curve.bound, curve.kind](curve.gains) / np.maximum(
            1.0, abs(curve.gains[:, 0])
        )
        assert np.max(np.abs(off)) < 1e-9


@pytest.mark.parametrize("plant", PLANTS)
@pytest.mark.parametrize("spec", [paper_d_stability(), d_stability(0.0, 110.0, 2.0)])
def test_on_each_boundary_a_root_is_where_the_boundary_says(
    plant: TransferFunction, spec: DStability
) -> None:
    curves = boundary_curves(plant, spec, (-0.6, 2.4))
    assert curves
    for curve in curves:
        near = np.all(np.abs(curve.gains) < 10.0, axis=1)
        roots = closed_loop_roots(plant, curve.gains[near])
        away = np.abs(roots - curve.s_rad_s[near][:, None]).min(axis=1)
        assert near.any()
        assert np.all(away < 1e-5 * np.maximum(1.0, np.abs(curve.s_rad_s[near])))


def test_a_loop_that_answers_at_once_is_refused() -> None:
    with pytest.raises(ValueError, match="strictly proper"):
        closed_loop_roots(LEAD, np.ones((1, 2)))
