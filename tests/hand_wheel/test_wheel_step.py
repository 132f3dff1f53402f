"""The wheel's motion step: exact enough, friction that sticks, and stops."""

from math import inf

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from steer_by_wire.hand_wheel.analysis.sampled_laws import zero_order_hold
from steer_by_wire.hand_wheel.settings import HandWheelSettings
from steer_by_wire.hand_wheel.wheel import GRIPS, WheelSettings, held_wheel
from steer_by_wire.hand_wheel.wheel_step import (
    AT_REST,
    Hands,
    WheelParams,
    WheelState,
    wheel_params,
    wheel_step,
)


def params(
    *, friction: float = 0.0, stop: float = inf, step_s: float = 1e-3, sensor: float = 0.0
) -> WheelParams:
    wheel = WheelSettings(sensor_n_m_rad=sensor, friction_n_m=friction, torque_n_m_max=20.0)
    return wheel_params(wheel, step_s)._replace(stop_rad=stop)


def held(grip: str, torque_n_m: float = 0.0) -> Hands:
    return Hands(GRIPS[grip], 0.0, 0.0, torque_n_m)


@pytest.mark.parametrize("grip", sorted(GRIPS))
@pytest.mark.parametrize(("sensor", "steps"), [(0.0, HandWheelSettings().steps), (150.0, 1000)])
def test_a_cycle_of_steps_moves_a_linear_wheel_as_the_exact_system(
    grip: str, sensor: float, steps: int
) -> None:
    wheel = WheelSettings(sensor_n_m_rad=sensor)
    exact = zero_order_hold(held_wheel(wheel, GRIPS[grip]), 0.01)
    p = params(step_s=0.01 / steps, sensor=sensor)

    def after(state: WheelState, command: float) -> WheelState:
        for _ in range(steps):
            state = wheel_step(p, state, command, held(grip))
        return state

    for place in {0, 1, 3, 4} & {*range(len(exact.b))}:
        start = np.eye(len(exact.b))[place]
        moved = after(WheelState(*start[:3], 0.0, *start[3:]), 0.0)
        assert moved[:2] == pytest.approx(exact.a[:2, place], abs=2e-5, rel=1e-3)
        assert not sensor or moved[4:] == pytest.approx(exact.a[3:, place], abs=2e-5, rel=1e-3)
    # The motor's torque is to the left.
    assert after(AT_REST, 1.0)[:2] == pytest.approx(-exact.b[:2], rel=1e-2)


@settings(max_examples=50)
@given(st.floats(0.1, 2.0), st.floats(-0.99, 0.99), st.floats(-1.0, 1.0))
def test_a_wheel_within_its_friction_stays_where_it_is(
    friction: float, share: float, angle: float
) -> None:
    p, state = params(friction=friction), AT_REST._replace(angle_rad=angle)
    for _ in range(50):
        state = wheel_step(p, state, 0.0, held("hands_off", share * friction))
    assert (state.angle_rad, state.rate_rad_s) == (angle, 0.0)
    for _ in range(50):
        state = wheel_step(p, state, 0.0, held("hands_off", 1.05 * friction))
    assert state.angle_rad > angle


@settings(max_examples=50)
@given(st.floats(0.1, 2.0), st.floats(0.5, 20.0), st.sampled_from(sorted(GRIPS)))
def test_friction_stops_a_moving_wheel_and_gives_it_no_energy(
    friction: float, rate: float, grip: str
) -> None:
    arms = GRIPS[grip]
    p, state = params(friction=friction), AT_REST._replace(rate_rad_s=rate)
    inertia, before = 0.035 + arms.inertia_kg_m2, inf
    for _ in range(5000):
        rate_before = state.rate_rad_s
        state = wheel_step(p, state, 0.0, held(grip))
        energy = inertia * state.rate_rad_s**2 + arms.stiffness_n_m * state.angle_rad**2
        # Within the step in which it stops or turns, its friction may act to the other side.
        turns = rate_before * state.rate_rad_s <= 0.0
        way = p.step_s * max(abs(rate_before), abs(state.rate_rad_s))
        assert energy <= before * (1.0 + 1e-12) + (2.0 * friction * way if turns else 0.0)
        before = energy
        if state.rate_rad_s == 0.0 and arms.stiffness_n_m * abs(state.angle_rad) <= friction:
            break
    assert state.rate_rad_s == 0.0


def test_a_wheel_ends_at_its_stop_and_comes_back() -> None:
    p, state = params(stop=1.0), AT_REST
    for _ in range(500):
        state = wheel_step(p, state, 0.0, held("hands_off", 5.0))
    assert (state.angle_rad, state.rate_rad_s) == (1.0, 0.0)
    state = wheel_step(p, state, 0.0, held("hands_off", -5.0))
    assert state.rate_rad_s < 0.0
