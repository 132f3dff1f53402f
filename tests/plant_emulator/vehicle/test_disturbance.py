import numpy as np
import pytest
from scipy.integrate import solve_ivp

from steer_by_wire.plant_emulator.path.settings import CircleSettings, StraightSettings
from steer_by_wire.plant_emulator.vehicle.disturbance import disturbance_intervals
from steer_by_wire.plant_emulator.vehicle.exact_propagation import BETA, DELTA, TABLE_ROWS, R, Y
from steer_by_wire.plant_emulator.vehicle.motion_parameters import motion_params
from steer_by_wire.plant_emulator.vehicle.moving_vehicle import Motion
from steer_by_wire.plant_emulator.vehicle.settings import (
    ActuatorSettings,
    DisturbanceSettings,
    DisturbanceStep,
    VehicleSettings,
)
from steer_by_wire.plant_emulator.vehicle.single_track_model import (
    VehicleParams,
    on_friction,
    state_matrices,
)
from steer_by_wire.runtime.settings import SettingsError

VEHICLE = VehicleSettings(speed_m_s=72.0 / 3.6)
PARAMS = VehicleParams(20.0, 2000.0, 3728.0, 190_000.0, 500_000.0, 1.3008, 1.5453, 2.0)


def moving(*steps: DisturbanceStep, side_force_arm_m: float = 0.0) -> Motion:
    disturbance = DisturbanceSettings(steps=steps, side_force_arm_m=side_force_arm_m)
    return Motion(motion_params(VEHICLE, ActuatorSettings(), StraightSettings(), disturbance))


def test_a_step_changes_what_it_gives_and_keeps_the_rest() -> None:
    disturbance = DisturbanceSettings(
        side_force_arm_m=0.5,
        steps=(
            DisturbanceStep(at_s=1.0, side_force_n=800.0),
            DisturbanceStep(at_s=2.5, yaw_moment_n_m=1000.0),
            DisturbanceStep(at_s=4.0, side_force_n=0.0, friction=0.4),
        ),
    )
    intervals = disturbance_intervals(disturbance, PARAMS)
    assert [i.start_ns for i in intervals] == [0, 1_000_000_000, 2_500_000_000, 4_000_000_000]
    assert [i.side_slip_disturbance_rad_s for i in intervals] == pytest.approx(
        [0.0, 800 / 40_000, 800 / 40_000, 0.0]
    )
    assert [i.yaw_disturbance_rad_s2 for i in intervals] == pytest.approx(
        [0.0, 400 / 3728, 1400 / 3728, 1000 / 3728]
    )
    assert [i.friction for i in intervals] == [1.0, 1.0, 1.0, 0.4]


def test_side_force_and_yaw_moment_lead_to_their_steady_state() -> None:
    motion = moving(
        DisturbanceStep(at_s=0.5, side_force_n=2000.0, yaw_moment_n_m=-300.0), side_force_arm_m=-0.4
    )
    motion.advance(500_000_000)
    assert motion.linear[R] == 0.0
    motion.advance(20_000_000_000)
    a, _ = state_matrices(PARAMS)
    load = [2000.0 / (2000.0 * 20.0), (-300.0 - 0.4 * 2000.0) / 3728.0]
    steady = -np.linalg.solve(a[:2, :2], load)
    assert (motion.linear[BETA], motion.linear[R]) == pytest.approx(steady, rel=1e-9)


def test_steering_offset_acts_like_steer_that_the_wheel_sensor_does_not_see() -> None:
    offset = moving(DisturbanceStep(at_s=0.25, steering_offset_rad=0.01))
    steered = moving()
    offset.advance(2_000_000_000)
    steered.advance(250_000_000)
    steered.command(0.01)
    steered.advance(2_000_000_000)
    assert offset.linear[Y] == pytest.approx(steered.linear[Y], rel=1e-12)
    assert offset.linear[R] == pytest.approx(steered.linear[R], rel=1e-12)
    assert offset.linear[DELTA] == 0.0


def test_friction_step_changes_the_vehicle_on_its_way() -> None:
    step = DisturbanceStep(at_s=0.7, friction=0.3, steering_offset_rad=0.01)
    motion = moving(step)
    motion.command(0.02)
    motion.advance(1_500_000_000)

    x = np.zeros(4)
    for p, steer, duration_s in ((PARAMS, 0.02, 0.7), (on_friction(PARAMS, 0.3), 0.03, 0.8)):
        a, b = state_matrices(p)
        x = solve_ivp(
            lambda _t, x, a=a, b=b, steer=steer: a @ x + b[:, 0] * steer,
            (0.0, duration_s),
            x,
            method="DOP853",
            rtol=1e-11,
            atol=1e-13,
        ).y[:, -1]
    assert motion.linear[Y] == pytest.approx(x[3], abs=1e-8)
    assert motion.linear[R] == pytest.approx(x[1], abs=1e-9)


def test_every_friction_has_one_table_however_often_it_returns() -> None:
    steps = tuple(
        DisturbanceStep(at_s=float(second), friction=friction)
        for second, friction in enumerate([0.5, 1.0, 0.5, 1.0, 0.5], start=1)
    )
    params = motion_params(
        VEHICLE, ActuatorSettings(), CircleSettings(), DisturbanceSettings(steps=steps)
    )
    assert len(params.table) == 2 * TABLE_ROWS
    assert len(params.first_rows) == 6


def test_steps_out_of_order_are_refused() -> None:
    with pytest.raises(SettingsError, match=r"steps must follow each other in time: 1.0 after"):
        DisturbanceSettings(steps=(DisturbanceStep(at_s=2.0), DisturbanceStep(at_s=1.0)))


def test_more_frictions_than_tables_are_refused() -> None:
    steps = tuple(DisturbanceStep(at_s=float(n), friction=0.5 + 0.01 * n) for n in range(17))
    with pytest.raises(SettingsError, match="at most 16 different values of friction, not 17"):
        DisturbanceSettings(steps=steps)
