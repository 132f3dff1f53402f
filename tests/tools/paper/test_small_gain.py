"""The small gain conditions (23) to (27): closed forms, published figures, the exact answer."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from steer_by_wire.controller.analysis.sampled_loop import SampledLoop
from steer_by_wire.controller.filters.continuous_filters import q_order_2
from steer_by_wire.controller.filters.nominal_model import paper_eq19, steer_to_lateral_error
from steer_by_wire.controller.filters.transfer_function import TransferFunction
from steer_by_wire.controller.laws.law_from_settings import design_law
from steer_by_wire.controller.laws.settings import LawSettings
from steer_by_wire.tools.paper.corners import corner_vehicles, preset_vehicle, published_law
from steer_by_wire.tools.paper.small_gain import (
    CdobParts,
    cdob_nominal_loop,
    cdob_parts,
    cdob_small_gain,
    condition_23,
    delay_uncertainty,
    multiplicative_uncertainty,
)

OMEGA_RAD_S, WIDE_RAD_S = np.geomspace(1e-2, 1e3, 400), np.geomspace(1e-3, 1e5, 10_000)
VEHICLE = steer_to_lateral_error(preset_vehicle("paper_nominal"))
VERTICES = [steer_to_lateral_error(vehicle) for vehicle in corner_vehicles()]


def cdob_law(
    q_cutoff_rad_s: float, filter_rad_s: float | None, washout_rad_s: float | None = None
) -> LawSettings:
    values = {"pd.derivative_filter_rad_s": filter_rad_s, "cdob.washout_rad_s": washout_rad_s}
    given_values = (f"{key}={value}" for key, value in values.items() if value is not None)
    return published_law("pd_cdob", f"cdob.q_cutoff_rad_s={q_cutoff_rad_s}", *given_values)


def parts_of(filter_rad_s: float | None, q_cutoff_rad_s: float = 200.0) -> CdobParts:
    return cdob_parts(cdob_law(q_cutoff_rad_s, filter_rad_s))


def is_stable(law: LawSettings, delay_s: float) -> bool:
    """Whether no root is outside the unit circle; two integrators that cancel are on it."""
    loop = SampledLoop(design_law(law), paper_eq19(), 1_000_000)
    poles = loop.closed_loop_poles(round(delay_s * 1e9))
    return bool(np.all(np.abs(poles) < 1.0 + 1e-5))


# Uncertainty


def test_a_delay_alone_is_the_uncertainty_of_27() -> None:
    """e^(-Ts) - 1, where the paper prints e^(-T); its size is 2 |sin(ωT/2)|."""
    delayed = delay_uncertainty(OMEGA_RAD_S, 0.08)
    np.testing.assert_allclose(delayed, np.exp(-0.08j * OMEGA_RAD_S) - 1.0, atol=1e-12)
    np.testing.assert_allclose(
        np.abs(delayed), 2.0 * np.abs(np.sin(0.04 * OMEGA_RAD_S)), atol=1e-12
    )


# (23)


@pytest.mark.parametrize(
    ("model", "lowest", "highest"), [(paper_eq19(), 0.60, 0.61), (VEHICLE, 0.95, 0.96)]
)
def test_over_the_box_the_uncertainty_stays_below_one_and_no_cutoff_is_too_large(
    model: TransferFunction, lowest: float, highest: float
) -> None:
    sizes = [multiplicative_uncertainty(each, model, WIDE_RAD_S) for each in VERTICES]
    assert lowest < np.abs(sizes).max() < highest
    for cutoff_rad_s in (0.5, 5.0, 50.0, 5e3):
        q = q_order_2(cutoff_rad_s)
        assert all(condition_23(q, vertex, model).size < 1.0 for vertex in VERTICES)


# (24) to (27)


def test_26_without_its_second_delay_is_the_denominator_of_18() -> None:
    """The denominator of (18) is 1 + C G_n Q + C G_n (1 - Q) e^(-Ts): one delay, not two."""
    parts = parts_of(20.0)
    s = (1j * OMEGA_RAD_S).astype(np.complex128)
    c_model = parts.compensator.times(parts.model).response(s)
    q = parts.q.response(s)
    denominator_18 = 1.0 + c_model * q + c_model * (1.0 - q) * np.exp(-0.08 * s)
    perturbed = 1.0 + delay_uncertainty(OMEGA_RAD_S, 0.08)
    ours = 1.0 + cdob_nominal_loop(parts, OMEGA_RAD_S) * perturbed
    np.testing.assert_allclose(ours * (1.0 + c_model * q), denominator_18, rtol=1e-9)


def test_filtered_at_20_rad_s_the_condition_holds_at_every_delay() -> None:
    """|Δ_m| is 2 at most, so a closed nominal loop below 1/2 needs no more to be known of T."""
    for filter_rad_s, low, high in ((20.0, 0.37, 0.38), (None, 0.66, 0.67)):
        nominal = cdob_nominal_loop(parts_of(filter_rad_s), np.geomspace(1e-3, 1e4, 20_000))
        assert low < np.max(np.abs(nominal / (1.0 + nominal))) < high


@pytest.mark.parametrize(
    ("q_cutoff_rad_s", "filter_rad_s", "washout_rad_s", "delay_s", "lowest", "highest"),
    [
        (100.0, 20.0, None, 0.12, 1.11, 1.13),
        (50.0, 10.0, None, 0.20, 1.11, 1.13),
        (100.0, 30.0, 3.0, 0.09, 1.19, 1.21),
    ],
)
def test_a_loop_that_fails_the_condition_can_be_stable(
    q_cutoff_rad_s: float,
    filter_rad_s: float,
    washout_rad_s: float | None,
    delay_s: float,
    lowest: float,
    highest: float,
) -> None:
    law = cdob_law(q_cutoff_rad_s, filter_rad_s, washout_rad_s)
    assert lowest < cdob_small_gain(cdob_parts(law), delay_s).size < highest
    assert is_stable(law, delay_s)


@settings(deadline=None, max_examples=20)
@given(
    st.floats(5.0, 300.0),
    st.one_of(st.none(), st.floats(2.0, 300.0)),
    st.one_of(st.none(), st.floats(0.5, 5.0)),
    st.floats(0.001, 0.1),
)
def test_a_loop_that_meets_the_condition_is_stable(
    q_cutoff_rad_s: float, filter_rad_s: float | None, washout_rad_s: float | None, delay_s: float
) -> None:
    law = cdob_law(q_cutoff_rad_s, filter_rad_s, washout_rad_s)
    if cdob_small_gain(cdob_parts(law), delay_s).size < 0.95:  # sampled: half a period more
        assert is_stable(law, delay_s)


def test_a_law_without_cdob_has_no_condition_25() -> None:
    with pytest.raises(ValueError, match="no CDOB"):
        cdob_parts(published_law("pd"))
