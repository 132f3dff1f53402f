"""The car in motion: equal bits compiled, independent of who reads it, at rest at rest."""

import math

import numpy as np
import pytest

from steer_by_wire.closed_loop.compiled.engine import run_compiled
from steer_by_wire.closed_loop.pair.virtual_pair import make_virtual_pair
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc.messages import Sender, SpeedRequest
from steer_by_wire.plant_emulator.node.node import PlantNode
from steer_by_wire.plant_emulator.settings import plant_motion_params, plant_preset
from steer_by_wire.plant_emulator.vehicle.car import car_motion
from steer_by_wire.plant_emulator.vehicle.exact_propagation import DELTA, PSI, R, Y
from steer_by_wire.plant_emulator.vehicle.moving_vehicle import Motion

MS = 1_000_000


def car_on(*overrides: str) -> Motion:
    settings = plant_preset("bmw_320i", ["path={kind='straight'}", *overrides])
    return Motion(plant_motion_params(settings))


@pytest.mark.parametrize("law", ["highway_pd", "highway_predictor"])
def test_a_compiled_run_of_a_car_equals_the_nodes_bit_for_bit(law: str) -> None:
    """With everything that can change: speed, grip, wind, jitter that splits steps.

    One law steers less above its speed, the other has other gains at every speed.
    """
    plant = plant_preset(
        "bmw_320i",
        [
            "duration_s=4",
            "path={kind='circle', radius_m=200.0}",
            "car.speed=[{at_s=0, speed_m_s=15}, {at_s=3, speed_m_s=19}]",
            "car.grip=[{from_m=20, friction=0.5}]",
            "disturbance.steps=[{at_s=1.00037, side_force_n=900}]",
            "path_ahead={}",
            "latency.downlink={model='gamma', mean_s=0.03, spread_s=0.01}",
        ],
    )
    controller = controller_preset(law)
    pair = make_virtual_pair(plant, controller)
    pair.run()
    compiled = run_compiled(plant, controller)
    assert len(compiled.time_s) == len(pair.plant.samples) == 400
    for name in ("lateral_error_m", "heading_error_rad", "yaw_rate_rad_s", "arc_length_m"):
        of_nodes = [getattr(sample, name) for sample in pair.plant.samples]
        assert np.array_equal(of_nodes, getattr(compiled, name)), name


def test_readings_do_not_move_the_car() -> None:
    often, rarely = car_on("car.speed_gain_1_s=3"), car_on("car.speed_gain_1_s=3")
    for at_ns in (10 * MS + 123, 700 * MS + 1):
        for motion in (often, rarely):
            motion.advance(at_ns)
            motion.command(0.03)
        for _ in range(50):
            often.advance(often.time_ns + 777_777)
    often.advance(2000 * MS)
    rarely.advance(2000 * MS)
    assert often.linear == rarely.linear
    assert often.place == rarely.place


def test_a_parked_car_does_not_drift() -> None:
    """With the wheel turned and wind it settles on its tyres; then no bit of its place changes.

    So an hour later it stands where it stood.
    """
    motion = car_on(
        "car.speed=[{at_s=0, speed_m_s=8}, {at_s=3, speed_m_s=0}]",
        "disturbance.steps=[{at_s=8, side_force_n=1500}]",
    )
    motion.command(0.05)
    motion.advance(40_000 * MS)
    assert motion.speed_m_s == 0.0
    parked = motion.linear[PSI], motion.linear[Y], motion.place
    for later_ms in (40_001, 41_000, 45_000):
        motion.advance(later_ms * MS)
        assert (motion.linear[PSI], motion.linear[Y], motion.place) == parked
        assert abs(motion.linear[R]) < 1e-16
    motion.command(0.0)
    motion.advance(50_000 * MS)
    assert motion.linear[DELTA] == 0.0  # not for ever on its way, through ever smaller numbers


@pytest.mark.parametrize("friction", ["coulomb", "lugre"])
def test_a_car_parked_on_its_rack_does_not_drift(friction: str) -> None:
    """With the wheel turned, on play, and with wind: by less than a micrometre an hour."""
    motion = car_on(
        f"car.rack={{friction='{friction}', play_rad=0.006}}",
        "car.speed=[{at_s=0, speed_m_s=4}, {at_s=2, speed_m_s=0}]",
        "disturbance.steps=[{at_s=4, side_force_n=1500}]",
    )
    motion.command(0.05)
    motion.advance(20_000 * MS)
    parked = motion.linear[:6]
    motion.advance(29_000 * MS)  # 1/400 of an hour
    assert np.abs(np.subtract(motion.linear[:6], parked)).max() < 1e-6 / 400.0
    assert abs(motion.linear[DELTA] - 0.05) < 1e-3


@pytest.mark.parametrize(
    "steering", ["actuator.lag_s=0.05", "car.rack={play_rad=0.006, friction='lugre'}"]
)
def test_half_the_step_moves_the_error_by_less_than_one_percent(
    steering: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a lane change that takes 0.6 of the grip, open loop."""

    def rms_m() -> float:
        motion, errors_m = car_on("vehicle.speed_m_s=25", steering), []
        for tick in range(400):
            motion.advance(tick * 10 * MS)
            motion.command(0.03 * math.sin(math.tau * tick / 200))
            errors_m.append(motion.linear[Y])
        return float(np.sqrt(np.mean(np.square(errors_m))))

    whole_m = rms_m()
    monkeypatch.setattr(car_motion, "STEP_NS", MS // 2)
    assert rms_m() == pytest.approx(whole_m, rel=0.01)
    assert rms_m() != whole_m


def test_the_place_on_the_path_follows_the_motion_at_large_angles() -> None:
    """On a circle, at up to 46 degrees to it: the pose moves as the speeds say."""
    motion = car_on("path={kind='circle', radius_m=40.0}", "vehicle.initial_heading_error_rad=-0.5")
    motion.command(-0.03)
    x, y, _ = motion.pose
    for tick in range(1, 700):
        motion.advance(tick * MS)
        _, (_, _, now, *_) = motion._state[1:]  # the speeds of the state itself
        car, (at_x, at_y, heading) = now.car, motion.pose
        heading -= 0.0005 * car.yaw_rate_rad_s
        x += 1e-3 * (car.speed_m_s * math.cos(heading) - car.lateral_speed_m_s * math.sin(heading))
        y += 1e-3 * (car.speed_m_s * math.sin(heading) + car.lateral_speed_m_s * math.cos(heading))
    assert motion.linear[PSI] < -0.8
    assert (at_x, at_y) == pytest.approx((x, y), abs=1e-3)


def test_a_car_that_slides_away_ends_the_run_in_words() -> None:
    plant = plant_preset("bmw_320i", ["car.friction=0.1", "path.length_m=20"])
    pair = make_virtual_pair(plant, controller_preset("highway_pd"))
    pair.run()
    report = pair.plant.report()
    assert "left its path" in report["failure"]
    assert pair.plant.samples[-1].time_s < 25.0
    assert any("the car slides" in line for line in report["warnings"])


def test_a_car_slows_down_when_asked_to() -> None:
    settings = plant_preset("bmw_320i", ["path={kind='straight'}", "start_on_first_command=false"])
    node, requests = PlantNode(settings, 0), Sender(SpeedRequest)
    speeds_m_s = []
    for tick in range(1000):
        now_ns = tick * 10 * MS
        if tick in (100, 110, 600):
            limit_m_s = 5.0 if tick < 600 else 80.0
            node.on_frame(requests.frame(SpeedRequest(speed_max_m_s=limit_m_s)), now_ns)
        node.on_tick(now_ns)
        speeds_m_s.append(node._motion.speed_m_s)
    assert speeds_m_s[90] == pytest.approx(16.67, abs=0.01)
    assert min(speeds_m_s) == pytest.approx(5.0, abs=0.3)
    assert speeds_m_s[-1] > 9.0
