"""The wheel's motion step: exact enough, friction that sticks, stops, and delays that shake it."""

from math import inf
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from steer_by_wire import feedback_stability
from steer_by_wire.closed_loop.scripting.feedback import (
    Rack,
    SampledFeedback,
    road_torque,
    sampled_feedback,
    unstable_round_trips,
)
from steer_by_wire.hand_wheel.analysis.sampled_laws import zero_order_hold
from steer_by_wire.hand_wheel.settings import HandWheelSettings
from steer_by_wire.hand_wheel.wheel import GRIPS, HandWheel, held_wheel
from steer_by_wire.hand_wheel.wheel_step import (
    AT_REST,
    Hands,
    WheelParams,
    WheelState,
    wheel_params,
    wheel_step,
)
from steer_by_wire.plant_emulator.vehicle.single_track_model import VehicleParams

SEDAN = VehicleParams(80 / 3.6, 1750.0, 2900.0, 110e3, 150e3, 1.25, 1.55, 0.0)


def params(
    *, friction: float = 0.0, stop: float = inf, step_s: float = 1e-3, sensor: float = 0.0
) -> WheelParams:
    return wheel_params(HandWheel(sensor_n_m_rad=sensor), friction, stop, 20.0, step_s)


def held(grip: str, torque_n_m: float = 0.0) -> Hands:
    return Hands(GRIPS[grip], 0.0, 0.0, torque_n_m)


def linear_map(grip: str, cycle_s: float, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Return what a cycle of steps makes of angle, rate and motor, and of the command."""

    def after(state: WheelState, command: float) -> list[float]:
        for _ in range(steps):
            state = wheel_step(params(step_s=cycle_s / steps), state, command, held(grip))
        return list(state[:3])

    units = [WheelState(*row, 0.0) for row in np.eye(3)]
    return np.array([after(unit, 0.0) for unit in units]).T, np.array(after(AT_REST, 1.0))


@pytest.mark.parametrize("grip", sorted(GRIPS))
def test_a_cycle_of_steps_moves_a_linear_wheel_as_the_exact_system(grip: str) -> None:
    steps = HandWheelSettings().steps
    f, g = linear_map(grip, 0.01, steps)
    exact = zero_order_hold(held_wheel(HandWheel(), GRIPS[grip]), 0.01)
    assert f[:2, :2] == pytest.approx(exact.a[:2, :2], abs=2e-5, rel=1e-3)
    assert g[:2] == pytest.approx(-exact.b[:2], rel=1e-2)  # the motor's torque is to the left


@given(st.floats(60.0, 300.0), st.sampled_from(sorted(GRIPS)), st.floats(-1.0, 1.0))
@settings(max_examples=20)
def test_a_sensor_that_gives_way_moves_as_an_integrator_says(
    sensor: float, grip: str, torque: float
) -> None:
    """The equations are written here once more, and integrated by scipy."""
    inertia, damping, stiffness = GRIPS[grip]
    rim = 0.85 * 0.035

    def derivative(_time_s: float, x: Any) -> list[float]:
        angle, rate, motor, above, above_rate = x
        twist = sensor * (above - angle)
        arms = torque - stiffness * above - damping * above_rate
        return [
            rate, (motor + twist - 0.15 * rate) / (0.035 - rim), (1.0 - motor) / 0.004,
            above_rate, (arms - twist) / (rim + inertia),
        ]  # fmt: skip

    exact = solve_ivp(derivative, (0.0, 0.3), [0.0] * 5, rtol=1e-9, atol=1e-12).y[:, -1]
    p, state = params(step_s=1e-4, sensor=sensor), AT_REST
    for _ in range(3000):
        state = wheel_step(p, state, 1.0, held(grip, torque))
    assert state.angle_rad == pytest.approx(exact[0], abs=2e-4)
    assert state.rim_rad == pytest.approx(exact[3], abs=2e-4)
    assert state.driver_torque_n_m == pytest.approx(sensor * (exact[3] - exact[0]), abs=0.02)


@pytest.mark.parametrize("cycle_s", [0.001, 0.01])
@pytest.mark.parametrize("grip", sorted(GRIPS))
def test_the_steps_move_no_boundary_by_half_a_millisecond(grip: str, cycle_s: float) -> None:
    road = road_torque(SEDAN, 12.0, Rack())
    exact = sampled_feedback(held_wheel(HandWheel(), GRIPS[grip]), road, cycle_s)
    f, g = linear_map(grip, cycle_s, round(cycle_s / 1e-3))
    stepped = SampledFeedback(exact.f.copy(), exact.g.copy(), exact.h, cycle_s)
    stepped.f[:3, :3], stepped.g[:3] = f, -g
    pairs = zip(unstable_round_trips(exact, 0.6), unstable_round_trips(stepped, 0.6), strict=True)
    for one, other in pairs:
        assert one.start_s == pytest.approx(other.start_s, abs=0.5e-3)


def growth(wheel: HandWheel, stiffness: float, delay_s: float, hz: float) -> float:
    """Return the amplitude after 60 periods over that after 20, on a spring that answers late."""
    behind = 50
    step_s = delay_s / (behind + 0.5)  # the command is held for a step
    p = wheel_params(wheel, 0.0, inf, 20.0, step_s)
    periods = int(1.0 / hz / step_s) + 1
    state, angles = AT_REST._replace(angle_rad=1e-3), [1e-3] * (behind + 1)
    for _ in range(60 * periods):
        state = wheel_step(p, state, -stiffness * angles[-behind - 1], held("hands_off"))
        angles.append(state.angle_rad)
    return max(map(abs, angles[-periods:])) / max(map(abs, angles[20 * periods : 21 * periods]))


@settings(max_examples=6)
@given(st.floats(0.01, 0.1), st.floats(0.1, 2.0), st.floats(1.0, 40.0))
def test_a_wheel_alone_settles_inside_and_shakes_outside(
    inertia: float, damping: float, stiffness: float
) -> None:
    exact = feedback_stability(
        inertia_kg_m2=inertia, damping_n_m_s=damping, stiffness_n_m=stiffness
    )
    assert exact.passive_delay_s < exact.stable_delay_s
    inside, outside = (
        growth(
            HandWheel(inertia, damping, motor_lag_s=1e-9),
            stiffness,
            factor * exact.stable_delay_s,
            exact.shakes_at_hz,
        )
        for factor in (0.98, 1.02)
    )
    assert inside < 1.0 < outside


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
