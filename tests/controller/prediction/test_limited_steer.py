"""The feedback within the lateral acceleration that the vehicle is to bear: against the plant's own
guard, drawn vehicles and states, and far beside the path.
"""

import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from steer_by_wire.controller.prediction.gains_over_speed import (
    EstimatorSettings,
    Feedback,
    design_schedule,
    steady_turn_rad,
    together,
)
from steer_by_wire.controller.prediction.prediction import steer_for
from steer_by_wire.controller.prediction.vehicle_kalman_filter import EstimatorState, model_step
from steer_by_wire.plant_emulator.vehicle.single_track_model import VehicleParams
from steer_by_wire.plant_emulator.vehicle.steady_turn import acceleration_gain_m_s2
from tests.support.loops.own_vehicle import VEHICLE

SPEED_M_S = 60.0 / 3.6
LIMIT_RAD = steady_turn_rad(VEHICLE, SPEED_M_S, 16.0)
(GAINS,) = together(
    [design_schedule(EstimatorSettings(), VEHICLE, 0.01, 0.01, Feedback(0.57, 0.0))]
)(SPEED_M_S)


def inside(reach: float) -> st.SearchStrategy[float]:
    return st.floats(-reach, reach)


STATES = st.builds(
    EstimatorState,
    *(st.just(0), inside(0.1), inside(0.5), inside(0.5), inside(20.0)),
    *(inside(0.01), inside(0.05), st.just(0.0)),
)


@given(
    *(st.floats(0.5, 40.0), st.floats(500.0, 20e3), st.floats(5e4, 1e6), st.floats(5e4, 1e6)),
    *(st.floats(0.8, 3.0), st.floats(0.8, 3.0), st.floats(0.5, 20.0)),
)
def test_the_limit_is_that_of_a_guard_with_the_same_acceleration(
    speed_m_s: float,
    mass_kg: float,
    front_n_rad: float,
    rear_n_rad: float,
    front_m: float,
    rear_m: float,
    acceleration_m_s2: float,
) -> None:
    vehicle = VEHICLE.model_copy(
        update={
            "virtual_mass_kg": mass_kg,
            "front_cornering_stiffness_n_rad": front_n_rad,
            "rear_cornering_stiffness_n_rad": rear_n_rad,
            "front_axle_distance_m": front_m,
            "rear_axle_distance_m": rear_m,
        }
    )
    axles_m = front_m, rear_m
    gain_m_s2 = acceleration_gain_m_s2(
        VehicleParams(speed_m_s, mass_kg, 1.0, front_n_rad, rear_n_rad, *axles_m, 1.0)
    )
    assume(gain_m_s2 < 1e6)  # just below its critical speed an oversteering vehicle has any gain
    found_rad = steady_turn_rad(vehicle, speed_m_s, acceleration_m_s2)
    assert found_rad == pytest.approx(acceleration_m_s2 / gain_m_s2, rel=1e-6)


@given(STATES)
def test_no_state_asks_for_more_and_within_the_bounds_the_feedback_is_linear(
    x: EstimatorState,
) -> None:
    steer_rad, linear_rad = steer_for(GAINS, x, LIMIT_RAD), steer_for(GAINS, x, math.inf)
    assert abs(steer_rad) <= LIMIT_RAD
    asked_rad = abs(GAINS.steer_y * x.lateral_error_m)
    if asked_rad <= 0.5 * LIMIT_RAD and abs(linear_rad) <= LIMIT_RAD:
        assert steer_rad == linear_rad
    straight = EstimatorState(0, 0.0, 0.0, 0.0, x.lateral_error_m, 0.0, 0.0, 0.0)
    assert abs(steer_for(GAINS, straight, LIMIT_RAD)) <= 0.5 * LIMIT_RAD


@pytest.mark.parametrize("error_m", [1.0, 5.0, 30.0])
def test_from_far_beside_its_path_the_vehicle_returns_without_crossing_it(error_m: float) -> None:
    def least_m(asked_rad: float) -> float:
        x = EstimatorState(0, 0.0, 0.0, 0.0, error_m, 0.0, 0.0, 0.0)
        errors_m = []
        for _ in range(2500):
            steer_rad = steer_for(GAINS, x, asked_rad)
            x = model_step(GAINS, x, min(max(steer_rad, -LIMIT_RAD), LIMIT_RAD))
            errors_m.append(x.lateral_error_m)
        assert abs(errors_m[-1]) < 1e-3 or asked_rad == math.inf
        return min(errors_m)

    assert least_m(LIMIT_RAD) > -0.1
    if error_m > 10.0:  # what the bound is for: the steering alone at its limit swings
        assert least_m(math.inf) < -1.0
