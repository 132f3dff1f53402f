"""The feedback laws: equal to the analysis, passive where asked for, and of the right sign."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from steer_by_wire.closed_loop.scripting.feedback import sampled_feedback
from steer_by_wire.hand_wheel.analysis import sampled_laws
from steer_by_wire.hand_wheel.analysis.nominal_road import Rack, road_torque, road_vehicle
from steer_by_wire.hand_wheel.feedback_laws import (
    FEEDBACK_AT_REST,
    FEEDBACK_LAWS,
    FeedbackInput,
    resist,
)
from steer_by_wire.hand_wheel.settings import HandWheelSettings
from steer_by_wire.hand_wheel.wheel import GRIPS, WheelSettings, held_wheel, sensed_torque
from steer_by_wire.plant_emulator.vehicle.single_track_model import VehicleParams, state_matrices

LAG_S, LOOSE = 0.02, GRIPS["loose"]


def hand_wheel(cycle_ms: float = 10.0, **feedback: Any) -> HandWheelSettings:
    model = {"actuator_lag_s": LAG_S}
    return HandWheelSettings.model_validate(
        {"cycle_ms": cycle_ms, "feedback": feedback, "nominal_model": model}
    )


@settings(max_examples=20)
@given(st.floats(3.0, 60.0), st.floats(1e3, 3e3), st.floats(0.0, 0.1))
def test_the_nominal_road_turns_as_the_plants_vehicle(
    speed: float, mass: float, lag_s: float
) -> None:
    plant = VehicleParams(speed, mass, 2900.0, 110e3, 150e3, 1.25, 1.55, 0.0)
    road = road_torque(road_vehicle(plant), 6.0, Rack(lag_s=lag_s + 1e-3))
    theirs = state_matrices(plant)
    assert road.a[1:, 1:] == pytest.approx(theirs.a[:2, :2])
    assert road.a[1:, 0] == pytest.approx(theirs.b[:2, 0])
    # Standing still sideways, the torque is the gradient's.
    at_rest = np.linalg.solve(-road.a[:1, :1], road.b[:1])
    assert road.c[0] * at_rest[0] == pytest.approx(6.0)


@settings(max_examples=10)
@given(st.sampled_from([1.0, 5.0, 10.0]), st.floats(2.0, 12.0), st.sampled_from(["cdob", "dob"]))
def test_an_observer_is_that_of_the_analysis(cycle_ms: float, gradient: float, law: str) -> None:
    wheel = hand_wheel(cycle_ms, law=law, torque_gradient_n_m=gradient)
    p, step = wheel.feedback_params, FEEDBACK_LAWS[law].step
    road = road_torque(road_vehicle(wheel.nominal_model), gradient, Rack(lag_s=LAG_S))
    held, sensed = held_wheel(WheelSettings(), LOOSE), sensed_torque(WheelSettings(), LOOSE)
    sampled = sampled_laws.sampled_dob(0.035, 0.15, wheel.cycle_s, 50.0)
    if law == "cdob":
        sampled = sampled_laws.sampled_cdob(road, wheel.cycle_s)
    loop = sampled_feedback(held, road, wheel.cycle_s, sampled, sensed)
    moved = sampled_laws.zero_order_hold(held, wheel.cycle_s)
    whole, ours, state = np.zeros(len(loop.g)), np.zeros(3), FEEDBACK_AT_REST
    for arrived in np.random.default_rng(0).normal(0.0, 1.0, 200):
        force = -float(arrived) / p.force_n_m_n
        u = FeedbackInput(float(ours[0]), 0.0, force, 0.0, float(sensed @ ours))
        state, against = step(p, state, u)
        ours = moved.a @ ours + moved.b * against
        whole = loop.f @ whole + loop.g * arrived
        assert ours == pytest.approx(whole[:3], rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("law", sorted(FEEDBACK_LAWS))
def test_each_law_turns_the_wheel_back(law: str) -> None:
    wheel = hand_wheel(law=law)
    p, state = wheel.feedback_params, FEEDBACK_AT_REST
    for _ in range(20):  # the wheels stand to the left, and the road pushes them to the right
        u = FeedbackInput(0.3, 0.0, -200.0, 0.3 / wheel.steering_ratio, 0.0)
        state, against = FEEDBACK_LAWS[law].step(p, state, u)
    _, torque = resist(p, state, against, 0.0)
    assert torque < -0.2


def felt(most_n_m_s: float, delay: int) -> list[float]:
    """Return the energy given to the feedback by a swinging wheel on a spring that comes late."""
    wheel = hand_wheel(5.0, passive_n_m_s_max=most_n_m_s or 1e-12)
    p, state, energies, energy = (wheel.feedback_params, FEEDBACK_AT_REST, [], 0.0)
    times = np.arange(2000) * wheel.cycle_s
    angles, rates = 0.2 * np.sin(9.0 * times), 1.8 * np.cos(9.0 * times)
    for index, rate in enumerate(rates.tolist()):
        late = float(angles[max(index - delay, 0)])
        state, torque = resist(p, state, 8.0 * late, rate)
        energy -= torque * rate * wheel.cycle_s
        energies.append(energy)
    return energies


def test_the_passivity_controller_gives_back_no_more_than_it_took() -> None:
    assert min(felt(0.0, delay=20)) < -1.0
    assert min(felt(20.0, delay=20)) > -1e-9
    assert -1.0 < min(felt(0.5, delay=20)) / 10.0 < -0.001  # it may damp too little


def test_damping_and_friction_of_the_motor_resist_the_rate() -> None:
    p, state = hand_wheel(damping_n_m_s=0.5, friction_n_m=0.2).feedback_params, FEEDBACK_AT_REST
    assert resist(p, state, 0.0, 2.0)[1] == pytest.approx(-1.2)
    assert resist(p, state, 0.0, -0.05)[1] == pytest.approx(0.125)
