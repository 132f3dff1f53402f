"""Roots in the demanded region, by hand."""

import math

import numpy as np
import pytest

from steer_by_wire.closed_loop.parameter_space.d_stability import (
    d_stability,
    in_s_plane,
    judge,
    paper_d_stability,
)
from steer_by_wire.closed_loop.parameter_space.gain_boundaries import closed_loop_roots
from steer_by_wire.controller.filters.nominal_model import paper_eq19

SPEC = paper_d_stability()
GOOD = (-0.5 + 0.2j, -0.5 - 0.2j)
FAST = (-90.0, -300.0)
PUBLISHED = np.array([[1.0596, 0.939]])


def pair(re: float, im: float) -> tuple[complex, complex]:
    return complex(re, im), complex(re, -im)


def verdict(*roots: complex) -> tuple[bool, ...]:
    judged = judge(SPEC, np.array(roots, dtype=np.complex128))
    return tuple(bool(part) for part in judged)


@pytest.mark.parametrize(
    ("roots", "settled", "damped", "dominant"),
    [
        ((*GOOD, *FAST), True, True, True),
        # σ = 0.3 1/s, for every root, however fast
        ((*pair(-0.301, 0.1), *FAST), True, True, True),
        ((*pair(-0.299, 0.1), *FAST), False, True, True),
        ((*GOOD, *pair(-0.29, 90.0)), False, True, True),
        # θ = 135°, for roots within R
        ((*pair(-0.5, 0.499), *FAST), True, True, True),
        ((*pair(-0.5, 0.501), *FAST), True, False, True),
        ((*GOOD, *pair(-5.0, 90.0)), True, True, True),
        # R = 1.3 rad/s, for the two roots nearest the origin
        ((*pair(-1.0, 0.83), *FAST), True, True, True),
        ((*pair(-1.0, 0.84), *FAST), True, True, False),
        ((-0.5, -1.29, *FAST), True, True, True),
        ((-0.5, -1.31, *FAST), True, True, False),
        ((-0.5, -0.6, -0.7, -90.0), True, True, True),
    ],
)
def test_each_demand_is_met_on_one_side_of_its_bound_and_not_on_the_other(
    roots: tuple[complex, ...], settled: bool, damped: bool, dominant: bool
) -> None:
    *demands, satisfied = verdict(*roots)
    assert demands == [settled, damped, dominant]
    assert satisfied == (settled and damped and dominant)


@pytest.mark.parametrize(
    ("sigma_1_s", "cone_angle_deg", "radius_rad_s", "message"),
    [
        (-0.1, 135.0, 1.3, "sigma = -0.1 1/s must be at least 0"),
        (0.3, 90.0, 1.3, "must be above 90° and below 180°"),
        (0.3, 180.0, 1.3, "must be above 90° and below 180°"),
        (0.3, 135.0, 0.3, "must be above sigma = 0.3 1/s"),
        (0.3, 135.0, math.nan, "must be above sigma"),
    ],
)
def test_a_specification_that_no_roots_can_meet_is_refused(
    sigma_1_s: float, cone_angle_deg: float, radius_rad_s: float, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        d_stability(sigma_1_s, cone_angle_deg, radius_rad_s)


def test_a_root_of_a_sampled_loop_stands_for_its_logarithm() -> None:
    s = np.array([-0.5 + 0.2j, -3.0 + 300.0j, -40.0])
    np.testing.assert_allclose(in_s_plane(np.exp(0.01 * s), 10_000_000), s, rtol=1e-12)
    negative, at_zero = in_s_plane(np.array([-0.5 + 0j, 0j]), 10_000_000)
    assert negative == pytest.approx(complex(100.0 * math.log(0.5), 100.0 * math.pi))
    assert at_zero.real < -1e4


# The published loop


def test_the_published_gains_place_the_dominant_pair_as_specified() -> None:
    import control  # and with it pyplot, which every worker would load when it collects

    plant = control.tf([227.6, 8.479e4, 3.627e4], [1.0, 459.2, 3.329e4, 0.0, 0.0])
    loop = control.feedback(plant * control.tf([0.939, 1.0596], [1.0]))
    by_control = np.sort_complex(control.poles(loop))
    ours = np.sort_complex(closed_loop_roots(paper_eq19(), PUBLISHED)[0])
    np.testing.assert_allclose(ours, by_control, rtol=1e-7)
    dominant = ours[np.argmin(abs(ours - (-0.55 + 0.2j)))]
    assert -0.5502 < dominant.real < -0.5500
    assert 0.1981 < dominant.imag < 0.1983
    assert all(verdict(*ours))
