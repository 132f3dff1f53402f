import math
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.plant_emulator.path.settings import StraightSettings
from steer_by_wire.plant_emulator.vehicle.actuator import (
    ActuatorParams,
    WheelPhase,
    at_rest,
    command_wheel,
    end_ramp,
    is_limited,
)
from steer_by_wire.plant_emulator.vehicle.exact_propagation import DELTA, propagate
from steer_by_wire.plant_emulator.vehicle.motion_parameters import motion_params
from steer_by_wire.plant_emulator.vehicle.moving_vehicle import Motion
from steer_by_wire.plant_emulator.vehicle.settings import (
    ActuatorSettings,
    DisturbanceSettings,
    VehicleSettings,
)
from steer_by_wire.runtime.node import NEVER_NS

ACTUATORS = {
    "lag": ActuatorSettings(lag_s=0.05),
    "rate": ActuatorSettings(rate_limit_rad_s=0.5),
    "lag and rate": ActuatorSettings(lag_s=0.05, rate_limit_rad_s=0.5),
    "play": ActuatorSettings(dead_band_rad=0.02),
    "all": ActuatorSettings(
        lag_s=0.03, rate_limit_rad_s=0.8, angle_limit_rad=0.1, dead_band_rad=0.01
    ),
}


@pytest.mark.parametrize("name", ACTUATORS)
def test_wheel_follows_a_servo_integrated_in_fine_steps(name: str) -> None:
    """Euler at 10 µs on δ' = clip((goal − δ)/lag, ± rate), the goal by the definition of play."""
    actuator = ACTUATORS[name]
    rate = actuator.rate_limit_rad_s or math.inf
    limit = actuator.angle_limit_rad or math.inf
    still = StraightSettings(), DisturbanceSettings()
    motion = Motion(motion_params(VehicleSettings(), actuator, *still))
    rng = random.Random(7)
    wheel, step_s, now_ns = 0.0, 1e-5, 0
    for _ in range(30):
        command = rng.uniform(-0.2, 0.2)
        motion.command(command)
        target = min(max(command, -limit), limit)
        goal = min(max(wheel, target - actuator.dead_band_rad), target + actuator.dead_band_rad)
        steps = rng.randrange(300, 8000)
        for _ in range(steps):
            wanted = (goal - wheel) / max(actuator.lag_s, step_s)
            wheel += step_s * min(max(wanted, -rate), rate)
        now_ns += steps * 10_000
        motion.advance(now_ns)
        assert motion.linear[DELTA] == pytest.approx(wheel, abs=1e-4)


@given(st.lists(st.tuples(st.floats(-0.7, 0.7), st.integers(1, 30_000_000)), max_size=20))
def test_transparent_actuator_adds_exactly_nothing(commands: list[tuple[float, int]]) -> None:
    motion = Motion(TRANSPARENT)
    linear, now_ns = motion.linear, 0
    for command, dt_ns in commands:
        motion.command(command)
        now_ns += dt_ns
        motion.advance(now_ns)
        beta, r, psi, y, _, rate, rho, rho_rate, w_beta, w_r = linear
        linear = (beta, r, psi, y, command, rate, rho, rho_rate, w_beta, w_r)
        linear = propagate(TRANSPARENT.table, 0, linear, dt_ns)
        assert motion.linear == linear
        assert motion.linear[DELTA] == command
        assert not motion.is_limited()


TRANSPARENT = motion_params(
    VehicleSettings(), ActuatorSettings(), StraightSettings(), DisturbanceSettings()
)


@given(st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=30))
def test_wheel_keeps_both_limits_whatever_is_commanded(commands: list[float]) -> None:
    motion = Motion(LIMITED)
    before = motion.linear[DELTA]
    for index, command in enumerate(commands, start=1):
        motion.command(command)
        motion.advance(index * 7_000_000)
        assert abs(motion.linear[DELTA]) <= 0.1 + 1e-12
        assert abs(motion.linear[DELTA] - before) <= 0.8 * 0.007 + 1e-12
        before = motion.linear[DELTA]


LIMITED = motion_params(
    VehicleSettings(), ACTUATORS["all"], StraightSettings(), DisturbanceSettings()
)


def test_ramp_ends_where_the_lag_takes_over() -> None:
    p = ActuatorParams(lag_s=0.1, rate_limit_rad_s=0.5)
    ramp = command_wheel(p, 0.0, 0.2, 1000)
    # 0.2 rad to go, of which the last 0.5 · 0.1 rad are settled: 0.15 rad at 0.5 rad/s.
    _, wheel_rate_rad_s, phase, goal_rad, clipped, end_ns = ramp
    assert phase is WheelPhase.RAMPING
    assert wheel_rate_rad_s == 0.5
    assert end_ns == pytest.approx(1000 + 300_000_000, abs=1)
    assert is_limited(ramp)
    settling = end_ramp(p, 0.15, goal_rad, clipped)
    _, wheel_rate_rad_s, phase, _, _, end_ns = settling
    assert phase is WheelPhase.SETTLING
    assert wheel_rate_rad_s == pytest.approx(0.5)
    assert end_ns == NEVER_NS
    assert not is_limited(settling)


def test_play_holds_the_wheel_until_the_command_has_crossed_it() -> None:
    p = ActuatorParams(dead_band_rad=0.02)
    assert command_wheel(p, 0.0, 0.1, 0)[0] == pytest.approx(0.08)
    assert command_wheel(p, 0.08, 0.07, 0)[0] == 0.08
    assert command_wheel(p, 0.08, 0.05, 0)[0] == pytest.approx(0.07)


def test_command_beyond_the_angle_limit_is_clipped_and_says_so() -> None:
    p = ActuatorParams(angle_limit_rad=0.6)
    assert command_wheel(p, 0.0, 0.7, 0)[:1] == (0.6,)
    assert is_limited(command_wheel(p, 0.0, 0.7, 0))
    assert not is_limited(command_wheel(p, 0.0, 0.6, 0))
    assert not is_limited(at_rest(0.6))
