"""Continuous loops with exact delay: the paper's equations, python-control, independent roots."""

import math
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from steer_by_wire.closed_loop.parameter_space.root_count import RootCount, count_roots
from steer_by_wire.closed_loop.parameter_space.uncertainty import paper_box
from steer_by_wire.controller.analysis.sampled_loop import SampledLoop
from steer_by_wire.controller.filters.continuous_filters import (
    pd_compensator,
    q_order_2,
    q_type_2,
    washout,
)
from steer_by_wire.controller.filters.nominal_model import paper_eq19, steer_to_lateral_error
from steer_by_wire.controller.filters.transfer_function import TransferFunction
from steer_by_wire.controller.laws.law_from_settings import design_law, required
from steer_by_wire.controller.laws.settings import LawSettings
from steer_by_wire.tools.paper.continuous_loop import (
    closed_loop_roots,
    continuous_law,
    dob_alone,
    dob_q,
    loop_response,
    reference_response,
)

EQ19 = paper_eq19()
CORNER = steer_to_lateral_error(paper_box().vertices()[3])
OMEGA_RAD_S = np.geomspace(1e-2, 1e3, 200)
S = np.asarray(1j * OMEGA_RAD_S, np.complex128)
LAWS = ("pd", "pd_dob", "pd_cdob", "pd_ddob")


def law_settings(
    law: str,
    filter_rad_s: float | None = 20.0,
    washout_rad_s: float | None = None,
    cdob_rad_s: float = 200.0,
    q_kind: str = "order_2",
) -> LawSettings:
    pd = {"proportional_gain_rad_m": 1.0596, "derivative_gain_rad_s_m": 0.939}
    if filter_rad_s is not None:
        pd["derivative_filter_rad_s"] = filter_rad_s
    cdob = {"q_cutoff_rad_s": cdob_rad_s}
    if washout_rad_s is not None:
        cdob["washout_rad_s"] = washout_rad_s
    return LawSettings.model_validate(
        {
            "law": law,
            "rate_hz": 1000,
            "pd": pd,
            "dob": {"q_cutoff_rad_s": 5.0, "q_kind": q_kind},
            "cdob": cdob,
            "nominal_model": {"kind": "paper_eq19"},
        }
    )


# As the paper writes it


@pytest.mark.parametrize("plant", [EQ19, CORNER])
def test_model_regulation_and_disturbance_rejection_are_12_and_13(plant: TransferFunction) -> None:
    q = q_order_2(5.0)
    law = dob_alone(q, EQ19)
    g, g_n, q_s = plant.response(S), EQ19.response(S), q.response(S)
    below = g * q_s + g_n * (1.0 - q_s)
    regulated = reference_response(law, plant, 0.0, OMEGA_RAD_S)
    rejected = 1.0 / (1.0 + loop_response(law, plant, 0.0, OMEGA_RAD_S))
    np.testing.assert_allclose(regulated, g_n * g / below, rtol=1e-9)
    np.testing.assert_allclose(rejected, g_n * (1.0 - q_s) / below, rtol=1e-9)


@pytest.mark.parametrize("q_kind", ["order_2", "type_2"])
@pytest.mark.parametrize("washout_rad_s", [None, 2.0])
def test_every_law_gives_the_response_of_its_block_diagram(
    washout_rad_s: float | None, q_kind: str
) -> None:
    """Solved for the signals y, u, u_new and y_fb at each ω, block by block."""
    for name, plant in product(LAWS, (EQ19, CORNER)):
        law = law_settings(name, washout_rad_s=washout_rad_s, q_kind=q_kind)
        c, g_n = pd_compensator(required(law.pd)).response(S), EQ19.response(S)
        h = 1.0 if washout_rad_s is None else washout(washout_rad_s).response(S)
        assert law.dob is not None
        q_d = dob_q(law.dob).response(S) if "ddob" in name or name == "pd_dob" else 0.0 * S
        q_c = q_order_2(200.0).response(S) if name.endswith("cdob") or "ddob" in name else 0.0 * S
        delayed = plant.response(S) * np.exp(-0.03 * S)
        one, zero = np.ones_like(S), np.zeros_like(S)
        equations = np.array(
            [
                [one, -delayed, zero, zero],  # y = P u
                [q_d / g_n, one - q_d, -one, zero],  # u = u_new - (Q/G_n) y + Q u
                [zero, zero, one, c],  # u_new = C (r - y_fb)
                [h * q_c - one, zero, -h * g_n * q_c, one],  # y_fb = y + H (G_n Q u_new - Q y)
            ]
        )
        right = np.array([zero, zero, c, zero])
        signals = np.linalg.solve(np.moveaxis(equations, 2, 0), right.T[:, :, None])
        found = reference_response(continuous_law(law), plant, 0.03, OMEGA_RAD_S)
        np.testing.assert_allclose(found, signals[:, 0, 0], rtol=1e-6)


# Margins


# Roots


@pytest.mark.parametrize(
    ("delay_s", "right"), [(0.0, 0), (1.56, 0), (1.58, 2), (7.85, 2), (7.86, 4)]
)
def test_an_integrator_with_delay_loses_a_pair_at_each_odd_quarter_turn(
    delay_s: float, right: int
) -> None:
    """s + e^(-sT) has a pair on the axis where T = π/2 + 2π k, at ω = 1."""
    roots = count_roots(np.array([1.0, 0.0]), np.array([1.0]), delay_s)
    assert (roots.right, roots.at_origin) == (right, 0)


def test_common_powers_of_s_are_counted_apart() -> None:
    found = count_roots(np.array([1.0, 3.0, 0.0, 0.0]), np.array([2.0, 0.0, 0.0]), 0.1)
    assert (found.right, found.at_origin, found.stable) == (0, 2, False)
    assert RootCount(0, 0, 1.0).stable


def test_a_loop_that_answers_at_once_is_refused() -> None:
    with pytest.raises(ValueError, match="strictly proper"):
        count_roots(np.array([1.0, 1.0]), np.array([0.5, 0.0]), 0.1)


coefficients = st.floats(-5.0, 5.0)


@settings(deadline=None)
@given(
    st.lists(coefficients, min_size=2, max_size=6), st.lists(coefficients, min_size=1, max_size=6)
)
def test_without_delay_the_count_is_that_of_the_polynomial(p: list[float], q: list[float]) -> None:
    undelayed, delayed = np.array([1.0, *p]), np.array(q[: len(p)])
    total = np.polyadd(undelayed, delayed)
    roots = np.roots(total)
    if np.all(np.abs(roots.real) > 1e-3):
        found = count_roots(undelayed, delayed, 0.0)
        assert found.right == np.count_nonzero(roots.real > 0.0)


@pytest.mark.parametrize("delay_s", [0.005, 0.02, 0.08, 0.16])
@pytest.mark.parametrize("law", LAWS)
def test_the_count_agrees_with_the_poles_of_the_law_sampled_at_1_khz(
    law: str, delay_s: float
) -> None:
    for filter_rad_s, plant in product((20.0, 5.0), (EQ19, CORNER)):
        design = law_settings(law, filter_rad_s, washout_rad_s=2.0)
        count = closed_loop_roots(continuous_law(design), plant, delay_s)
        loop = SampledLoop(design_law(design), plant, 1_000_000)
        poles = loop.closed_loop_poles(round(delay_s * 1e9))
        assert count.clearance > 0.02  # a period of delay decides nothing
        assert count.right == np.count_nonzero(np.abs(poles) > 1.0)


@pytest.mark.parametrize("law", ["pd_cdob", "pd_ddob"])
def test_without_washout_two_roots_stay_at_the_origin_and_the_vehicle_drifts(law: str) -> None:
    published = continuous_law(law_settings(law, 20.0))
    assert closed_loop_roots(published, EQ19, 0.08)._replace(clearance=0.0) == (0, 2, 0.0)
    washed = continuous_law(law_settings(law, 20.0, washout_rad_s=2.0))
    assert closed_loop_roots(washed, EQ19, 0.08).stable


def test_the_type_2_observer_leaves_nothing_of_a_ramp() -> None:
    """y/d of (13) at small ω: 1 - Q falls as ω for (20) and as ω² for type 2."""
    omega_rad_s = np.array([1e-3, 1e-2])
    for q, slope in ((q_order_2(5.0), 1.0), (q_type_2(5.0), 2.0)):
        low, high = 1.0 / np.abs(1.0 + loop_response(dob_alone(q, EQ19), CORNER, 0.0, omega_rad_s))
        assert math.log10(high / low) == pytest.approx(slope, abs=0.01)
