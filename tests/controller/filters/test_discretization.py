"""Discretisation against scipy's, the settings it refuses, and the filters' values at rest."""

from math import pi
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from pydantic import ValidationError
from scipy import signal

from steer_by_wire.controller.filters.continuous_filters import q_order_2, q_type_2, washout
from steer_by_wire.controller.filters.discretization import (
    design_cdob,
    design_dob,
    hold_equivalent_order_2,
    hold_equivalent_type_2,
    tustin_sections,
)
from steer_by_wire.controller.filters.nominal_model import paper_eq19
from steer_by_wire.controller.filters.sections import Section
from steer_by_wire.controller.filters.settings import CdobSettings, DobSettings
from steer_by_wire.controller.filters.transfer_function import TransferFunction
from steer_by_wire.controller.laws.settings import LawSettings

PERIOD_S = 0.01
EQ19 = {"kind": "paper_eq19"}
PD = {"proportional_gain_rad_m": 1.0596, "derivative_gain_rad_s_m": 0.939}


def respond(sections: tuple[Section, ...], z: NDArray[np.complex128]) -> NDArray[np.complex128]:
    value = np.ones_like(z)
    for b0, b1, b2, a1, a2 in sections:
        value *= (b0 + b1 / z + b2 / z**2) / (1.0 + a1 / z + a2 / z**2)
    return value


def at_rest(sections: tuple[Section, ...]) -> float:
    return float(respond(sections, np.array([1.0 + 0.0j]))[0].real)


@pytest.mark.parametrize("period_s", [0.1, 0.01, 0.001])
@pytest.mark.parametrize(
    "transfer",
    [
        q_order_2(5.0).times(paper_eq19().inverse()),
        q_type_2(5.0).times(paper_eq19().inverse()),
        washout(3.0).times(paper_eq19()),
        paper_eq19(),
    ],
    ids=["Q/Gn", "type-2 Q/Gn", "H Gn", "Gn"],
)
def test_tustin_is_the_continuous_filter_at_the_warped_frequency(
    transfer: TransferFunction, period_s: float
) -> None:
    z = np.exp(1j * np.geomspace(1e-3, 0.95 * pi, 30)).astype(np.complex128)
    warped = (2.0 / period_s * (z - 1.0) / (z + 1.0)).astype(np.complex128)
    discrete = respond(tustin_sections(transfer, period_s), z)
    assert np.allclose(discrete, transfer.response(warped), rtol=1e-8, atol=0.0)


@given(st.floats(0.1, 300.0), st.sampled_from([0.1, 0.01, 0.001]))
def test_hold_equivalents_are_those_of_scipy(omega_rad_s: float, period_s: float) -> None:
    tau = 1.0 / omega_rad_s
    order_2 = ([1.0], [tau**2, 2.0 * tau, 1.0])
    type_2 = ([3.0 * tau, 1.0], np.poly([-omega_rad_s] * 3) * tau**3)
    z = np.exp(1j * np.linspace(0.05, 3.1, 20))
    for sections, (numerator, denominator) in (
        ((hold_equivalent_order_2(omega_rad_s, period_s),), order_2),
        (hold_equivalent_type_2(omega_rad_s, period_s), type_2),
    ):
        b, a, _ = signal.cont2discrete((numerator, denominator), period_s, method="zoh")
        expected = np.polyval(np.ravel(b), z) / np.polyval(a, z)
        np.testing.assert_allclose(respond(sections, z) / z, expected, rtol=1e-4, atol=1e-9)


@pytest.mark.parametrize("kind", ["order_2", "type_2"])
def test_observers_pass_the_command_and_ignore_a_constant_error_at_rest(kind: Any) -> None:
    dob = design_dob(DobSettings(q_cutoff_rad_s=5.0, q_kind=kind), paper_eq19(), PERIOD_S)
    assert at_rest(dob.command_filter) == pytest.approx(1.0, abs=1e-9)
    assert at_rest(dob.error_filter) == 0.0
    cdob = design_cdob(CdobSettings(q_cutoff_rad_s=20.0), paper_eq19(), PERIOD_S)
    assert at_rest((cdob.command_filter,)) == pytest.approx(1.0, abs=1e-12)
    assert at_rest(cdob.error_filter) == 0.0


def test_washout_leaves_a_stable_compensation_and_its_absence_two_integrators() -> None:
    with_washout = design_cdob(
        CdobSettings(q_cutoff_rad_s=20.0, washout_rad_s=3.0), paper_eq19(), PERIOD_S
    )
    without = design_cdob(CdobSettings(q_cutoff_rad_s=20.0), paper_eq19(), PERIOD_S)
    expected = 3.627e4 / 3.329e4 / 3.0**2  # s²/(s + 3)² · G_n at s = 0
    assert at_rest(with_washout.compensation) == pytest.approx(expected, rel=1e-9)
    assert any(1.0 + a1 + a2 == 0.0 for _, _, _, a1, a2 in without.compensation)


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ({"pd": {**PD, "derivative_filter_rad_s": 315.0}}, r"pd\.derivative_filter_rad_s = 315"),
        ({"dob": {"q_cutoff_rad_s": 315.0}}, r"dob\.q_cutoff_rad_s = 315 must be below .* 314\.2"),
        ({"cdob": {"q_cutoff_rad_s": 1e3}}, r"cdob\.q_cutoff_rad_s = 1000"),
        ({"cdob": {"q_cutoff_rad_s": 1.0, "washout_rad_s": 400.0}}, r"cdob\.washout_rad_s"),
    ],
)
def test_a_cutoff_at_or_beyond_nyquist_is_refused_by_name(
    tables: dict[str, Any], message: str
) -> None:
    with pytest.raises(ValidationError, match=message):
        LawSettings.model_validate({"law": "pd", "rate_hz": 100.0, "pd": PD, **tables})


@pytest.mark.parametrize(
    ("law", "given_tables", "missing"),
    [
        ("pd_dob", {"nominal_model": EQ19}, "dob"),
        ("pd_cdob", {"dob": {"q_cutoff_rad_s": 5.0}, "nominal_model": EQ19}, "cdob"),
        ("pd_ddob", {"dob": {"q_cutoff_rad_s": 5.0}, "nominal_model": EQ19}, "cdob"),
        ("pd_dob", {"dob": {"q_cutoff_rad_s": 5.0}}, "nominal_model"),
    ],
)
def test_a_law_without_its_table_is_refused(
    law: str, given_tables: dict[str, Any], missing: str
) -> None:
    with pytest.raises(ValidationError, match=rf"needs the table \[{missing}\]"):
        LawSettings.model_validate({"law": law, "pd": PD, **given_tables})
