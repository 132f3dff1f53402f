import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from steer_by_wire.plant_emulator.vehicle.exact_propagation import (
    DIGIT_VALUES,
    ENTRIES,
    TABLE_ROWS,
    LinearState,
    Y,
    augmented_matrix,
    propagate,
    table_rows,
    transition_table,
)
from steer_by_wire.plant_emulator.vehicle.single_track_model import VehicleParams

PAPER = VehicleParams(5.0 / 3.6, 2000.0, 3728.0, 190_000.0, 500_000.0, 1.3008, 1.5453, 2.0)
M = augmented_matrix(PAPER, 0.0)
SETTLING = augmented_matrix(PAPER, 20.0)
TABLE = [*table_rows(transition_table(M)), *table_rows(transition_table(SETTLING))]

states = st.tuples(*[st.floats(-1.0, 1.0)] * 10)
steps = st.one_of(st.integers(0, 2 * DIGIT_VALUES), st.integers(0, 200_000_000))


@given(states, steps, steps)
def test_two_steps_are_one_step(z: LinearState, first_ns: int, second_ns: int) -> None:
    twice = propagate(TABLE, 0, propagate(TABLE, 0, z, first_ns), second_ns)
    assert twice == pytest.approx(propagate(TABLE, 0, z, first_ns + second_ns), abs=1e-12)


@pytest.mark.parametrize(("m", "first_row"), [(M, 0), (SETTLING, TABLE_ROWS)])
@given(z=states, dt_ns=steps)
def test_a_step_is_the_matrix_exponential(
    m: np.ndarray, first_row: int, z: LinearState, dt_ns: int
) -> None:
    expected = expm(m * (dt_ns * 1e-9)) @ np.array(z)
    assert propagate(TABLE, first_row, z, dt_ns) == pytest.approx(expected, abs=1e-12)


def test_a_nanosecond_is_not_rounded_away() -> None:
    z = (0.1, 0.2, 0.3, 0.0, 0.05, 0.0, 0.0, 0.0, 0.0, 0.0)
    rate = (M @ np.array(z))[3]
    assert propagate(TABLE, 0, z, 1)[Y] == pytest.approx(rate * 1e-9, rel=1e-6)


def test_table_leaves_out_nothing_but_zeros_and_ones() -> None:
    left_out = np.ones((10, 10), dtype=bool)
    left_out[tuple(np.array(ENTRIES).T)] = False
    for m in (M, SETTLING):
        assert (expm(0.01 * m)[left_out] == np.eye(10)[left_out]).all()


@pytest.mark.parametrize("speed_m_s", [0.14, 1.4, 14.0, 69.0])
@pytest.mark.parametrize("mass_kg", [100.0, 2000.0, 100_000.0])
def test_table_is_accurate_for_the_extremes_of_the_settings(
    speed_m_s: float, mass_kg: float
) -> None:
    p = PAPER._replace(speed_m_s=speed_m_s, virtual_mass_kg=mass_kg)
    m = augmented_matrix(p, 1.0)
    table = table_rows(transition_table(m))
    rows, columns = np.array(ENTRIES).T
    for index, dt_ns in ((4095, 4095), (DIGIT_VALUES + 1, 4096), (TABLE_ROWS - 1, 4095 * 4096)):
        expected = expm(m * (dt_ns * 1e-9))[rows, columns]
        assert table[index] == pytest.approx(expected, rel=1e-10, abs=1e-14)


def test_a_vehicle_beyond_computing_is_refused() -> None:
    unstable = PAPER._replace(rear_cornering_stiffness_n_rad=-1e12)
    with pytest.raises(ValueError, match="overflows"):
        transition_table(augmented_matrix(unstable, 0.0))
