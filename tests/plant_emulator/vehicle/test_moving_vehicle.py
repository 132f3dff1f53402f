import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.plant_emulator.path.path import curvature
from steer_by_wire.plant_emulator.path.settings import (
    CircleSettings,
    EllipseSettings,
    PathSettings,
    StraightSettings,
)
from steer_by_wire.plant_emulator.vehicle.exact_propagation import DELTA, PSI, RHO, TABLE_ROWS, Y
from steer_by_wire.plant_emulator.vehicle.motion_parameters import MotionParams, motion_params
from steer_by_wire.plant_emulator.vehicle.moving_vehicle import Motion
from steer_by_wire.plant_emulator.vehicle.settings import (
    ActuatorSettings,
    DisturbanceSettings,
    DisturbanceStep,
    VehicleSettings,
)

BUSY = motion_params(
    VehicleSettings(speed_m_s=30.0 / 3.6),
    ActuatorSettings(lag_s=0.03, rate_limit_rad_s=0.8, angle_limit_rad=0.1, dead_band_rad=0.002),
    EllipseSettings(semi_major_axis_m=60.0, semi_minor_axis_m=30.0),
    DisturbanceSettings(
        steps=(
            DisturbanceStep(at_s=0.05, side_force_n=500.0),
            DisturbanceStep(at_s=0.13, friction=0.6, yaw_moment_n_m=-200.0),
        )
    ),
)


def quiet(path: PathSettings, vehicle: VehicleSettings | None = None) -> MotionParams:
    return motion_params(
        vehicle or VehicleSettings(), ActuatorSettings(), path, DisturbanceSettings()
    )


@given(
    st.lists(st.integers(0, 300_000_000), max_size=30),
    st.lists(st.tuples(st.integers(0, 299_999_999), st.floats(-0.2, 0.2)), max_size=5),
)
def test_looking_at_the_motion_does_not_change_it(
    looks_ns: list[int], commands: list[tuple[int, float]]
) -> None:
    rarely, often = Motion(BUSY), Motion(BUSY)
    for at_ns, steer_rad in [*sorted(commands), (300_000_000, 0.0)]:
        rarely.advance(at_ns)
        for look_ns in sorted(looks_ns):
            if often.time_ns <= look_ns <= at_ns:
                often.advance(look_ns)
        often.advance(at_ns)
        assert often.linear == pytest.approx(rarely.linear, abs=1e-11)
        rarely.command(steer_rad)
        often.command(steer_rad)


def test_motion_starts_at_rest_on_the_path_with_its_curvature_before_it() -> None:
    motion = Motion(quiet(EllipseSettings()))
    assert motion.time_ns == 0
    assert motion.linear[RHO] == pytest.approx(78.2 / 41.74**2)
    assert (motion.linear[Y], motion.linear[PSI], motion.linear[DELTA]) == (0.0, 0.0, 0.0)
    # The ellipse starts northbound at (a, 0): the centre of gravity stands south of it.
    assert motion.pose == pytest.approx((78.2, -2.0, 0.5 * math.pi))


def test_motion_starts_next_to_the_path_where_the_settings_say() -> None:
    next_to_it = VehicleSettings(initial_lateral_error_m=0.7, initial_heading_error_rad=-0.3)
    motion = Motion(quiet(StraightSettings(), next_to_it))
    assert (motion.linear[Y], motion.linear[PSI]) == (0.7, -0.3)
    # The preview point is 0.7 m to the left; the centre of gravity 2 m behind it.
    at = -2.0 * math.cos(0.3), 0.7 + 2.0 * math.sin(0.3), -0.3
    assert motion.pose == pytest.approx(at)


def test_curvature_and_arc_length_follow_the_path_over_laps() -> None:
    params = quiet(EllipseSettings(), VehicleSettings(speed_m_s=200.0 / 3.6))
    motion = Motion(params)
    for second in np.linspace(0.0, 20.0, 300):
        motion.advance(round(second * 1e9))
        assert motion.arc_length_m == pytest.approx(motion.speed_m_s * second, abs=1e-6)
        assert motion.linear[RHO] == pytest.approx(
            curvature(params.path, motion.arc_length_m), abs=1e-8
        )


def test_vehicle_seen_from_above_moves_where_its_velocity_points() -> None:
    """The vehicle integrated in the world, with nothing of (1)'s errors, stays on the same track.

    Left over is the second order of the small angles, 0.3 mm. Were the arc length that of the
    centre of gravity, the tracks would part by 27 cm.
    """
    params = quiet(CircleSettings(radius_m=200.0))
    v, m, j = params.speed_m_s, 2000.0, 3728.0
    c_f, c_r, l_f, l_r = 190_000.0, 500_000.0, 1.3008, 1.5453

    def derivative(steer: float, x: np.ndarray) -> np.ndarray:
        _, _, heading, side_slip, yaw_rate = x
        front = c_f * (steer - side_slip - l_f * yaw_rate / v)
        rear = c_r * (-side_slip + l_r * yaw_rate / v)
        return np.array(
            [
                v * math.cos(heading + side_slip),
                v * math.sin(heading + side_slip),
                yaw_rate,
                (front + rear) / (m * v) - yaw_rate,
                (l_f * front - l_r * rear) / j,
            ]
        )

    motion = Motion(params)
    world = np.array([*motion.pose, 0.0, 0.0])
    worst_m = 0.0
    for tick in range(2000):
        steer = 2.846 / 200.0 - 0.2 * motion.linear[Y] - 0.2 * motion.linear[PSI]
        motion.command(steer)
        motion.advance((tick + 1) * 10_000_000)
        for _ in range(10):  # Runge-Kutta at 1 ms
            k1 = derivative(steer, world)
            k2 = derivative(steer, world + 0.0005 * k1)
            k3 = derivative(steer, world + 0.0005 * k2)
            k4 = derivative(steer, world + 0.001 * k3)
            world = world + 0.001 / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        x, y, heading = motion.pose
        across = -(x - world[0]) * math.sin(heading) + (y - world[1]) * math.cos(heading)
        worst_m = max(worst_m, abs(across))
        assert heading == pytest.approx(world[2], abs=1e-9)
    assert worst_m < 1e-3


def test_motion_in_the_loop_reproduces_table_2() -> None:
    """Corner d under PD at 1 kHz, y' from the state: the continuous law but for half a period."""
    motion = Motion(
        quiet(EllipseSettings(), VehicleSettings(speed_m_s=7.0 / 3.6, virtual_mass_kg=5000.0))
    )
    squares = 0.0
    ticks = 200_000
    for tick in range(1, ticks + 1):
        beta, r, psi, y, *_ = motion.linear
        drift = motion.speed_m_s * (beta + psi) + 2.0 * r
        motion.command(-1.0596 * y - 0.939 * drift)
        motion.advance(tick * 1_000_000)
        squares += motion.linear[Y] ** 2
    assert 0.0526 - 2e-4 < math.sqrt(squares / ticks) < 0.0526 + 2e-4


def test_only_the_tables_that_can_occur_are_built() -> None:
    def tables(actuator: ActuatorSettings) -> int:
        params = motion_params(
            VehicleSettings(), actuator, StraightSettings(), DisturbanceSettings()
        )
        return len(params.table) // TABLE_ROWS

    assert tables(ActuatorSettings()) == 1
    assert tables(ActuatorSettings(rate_limit_rad_s=1.0)) == 1
    assert tables(ActuatorSettings(lag_s=0.1)) == 1
    assert tables(ActuatorSettings(lag_s=0.1, rate_limit_rad_s=1.0)) == 2
