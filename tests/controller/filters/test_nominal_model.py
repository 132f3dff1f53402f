"""The nominal model: the published coefficients, and the vehicle from three independent sides."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from steer_by_wire.controller.filters.nominal_model import NominalVehicle, paper_eq19, vehicle_model
from steer_by_wire.controller.filters.transfer_function import Factor, TransferFunction

PAPER = NominalVehicle(2000.0, 3728.0, 190e3, 500e3, 1.3008, 1.5453, 2.0, 5.0 / 3.6)
OVERSTEERING = PAPER._replace(rear_cornering_stiffness_n_rad=50e3)


def state_space(vehicle: NominalVehicle) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return A and the steering input of (1) with (2) corrected; states β, r, Δψ, y."""
    m, j, c_f, c_r, l_f, l_r, l_s, v = vehicle
    lever = c_r * l_r - c_f * l_f
    a = np.array(
        [
            [-(c_r + c_f) / (m * v), -1.0 + lever / (m * v**2), 0.0, 0.0],
            [lever / j, -(c_r * l_r**2 + c_f * l_f**2) / (j * v), 0.0, 0.0],
            [0.0, 1.0, 0.0, 0.0],
            [v, l_s, v, 0.0],
        ]
    )
    return a, np.array([c_f / (m * v), c_f * l_f / j, 0.0, 0.0])


def vehicles() -> st.SearchStrategy[NominalVehicle]:
    return st.builds(
        NominalVehicle,
        st.floats(800.0, 5000.0),
        st.floats(1000.0, 8000.0),
        st.floats(5e4, 2e5),
        st.floats(2.5e5, 6e5),  # stiff enough to understeer at any speed
        st.floats(1.0, 1.6),
        st.floats(1.0, 1.6),
        st.floats(0.5, 5.0),
        st.floats(0.5, 30.0),
    )


def test_equation_19_has_the_printed_coefficients() -> None:
    s = 2.0j
    printed = (227.6 * s**2 + 8.479e4 * s + 3.627e4) / (s**4 + 459.2 * s**3 + 3.329e4 * s**2)
    assert paper_eq19().response(np.array([s]))[0] == pytest.approx(printed, rel=1e-12)


@given(vehicles())
def test_the_closed_form_equals_the_state_space(vehicle: NominalVehicle) -> None:
    a, b = state_space(vehicle)
    s = (1j * np.geomspace(0.01, 300.0, 12)).astype(np.complex128)
    expected = np.array([np.linalg.solve(si * np.eye(4) - a, b)[3] for si in s])
    np.testing.assert_allclose(vehicle_model(vehicle).response(s), expected, rtol=1e-6)


def test_an_unstable_nominal_vehicle_is_refused() -> None:
    assert vehicle_model(OVERSTEERING).denominator[0].hurwitz
    with pytest.raises(ValueError, match="unstable"):
        vehicle_model(OVERSTEERING._replace(speed_m_s=20.0))


@pytest.mark.parametrize(
    ("transfer", "message"),
    [
        (TransferFunction(1, (), (Factor(1.0, 2.0, 1.0),)), "quadratic factors"),
        (TransferFunction(2, (), (Factor(0.0, 1.0, 1.0),)), "proper sections"),
    ],
)
def test_what_does_not_split_into_sections_is_refused(
    transfer: TransferFunction, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        transfer.biquads()
