"""The truth on the bus: deviation of the centre of gravity, and what the axles of a car give."""

import math
from typing import Any

import pytest

from steer_by_wire.closed_loop.recordings.held_path import PREVIEW_M, CgDeviation
from steer_by_wire.dbc.messages import CarTruth, GroundTruth, LateralError, VehicleState
from steer_by_wire.plant_emulator.path.drivability import GRAVITY_M_S2
from tests.support.frames.made_messages import error_of, message_with, motion_of
from tests.support.nodes.plant_link import PERIOD_NS, START_NS, link

NOISY = {"sensor_noise": {"lateral_error_m": 0.05}, "start_on_first_command": False}
LATE = {"uplink": {"mean_s": 0.2, "loss": 0.5}}


def test_it_is_sent_only_if_the_settings_say_so() -> None:
    tested = link()
    tested.tick_until(START_NS + 10 * PERIOD_NS)
    assert tested.messages(GroundTruth) == []


def test_it_is_of_each_sample_and_passes_neither_noise_nor_network() -> None:
    tested = link(ground_truth=True, latency=LATE, **NOISY)
    tested.tick_until(START_NS + 300 * PERIOD_NS)
    truths = tested.messages(GroundTruth)
    assert [at_ns for at_ns, _ in truths] == [START_NS + n * PERIOD_NS for n in range(301)]
    assert len(tested.messages(LateralError)) < 200
    for (_, message), sample in zip(truths, tested.node.samples, strict=True):
        assert message.cg_deviation_m == pytest.approx(sample.cg_deviation_m, abs=2.6e-6)
    assert abs(truths[-1][1].cg_deviation_m) > 0.01


def truths_in_a_bend(ticks: int, **tables: Any) -> tuple[list[CarTruth], list[VehicleState]]:
    """Return what a car tells of a left bend of 160 m at 20 m/s, and brakes from 4 s on."""
    profile = [(0.0, 20.0), (4.0, 20.0), (6.0, 6.0)]
    speed = [{"at_s": at_s, "speed_m_s": speed_m_s} for at_s, speed_m_s in profile]
    bend = {"car": {"speed": speed}, "path": {"kind": "circle", "radius_m": 160.0}}
    tested = link(ground_truth=True, **bend, **tables, start_on_first_command=False)
    for tick in range(ticks):
        tested.command(START_NS + tick * PERIOD_NS + 1, 0.0275)
    states = [message for _, message in tested.messages(VehicleState)]
    return [message for _, message in tested.messages(CarTruth)], states


def test_a_car_tells_how_its_axles_bear_a_bend_and_braking() -> None:
    truths, states = truths_in_a_bend(560)
    bend, braking = truths[380], truths[550]
    side_m_s2 = states[190].speed_m_s * states[190].yaw_rate_rad_s
    assert bend.lateral_acceleration_m_s2 == pytest.approx(side_m_s2, rel=0.02)
    # In a steady bend each axle carries its share of the weight and of the side force.
    for used in (bend.front_grip_used, bend.rear_grip_used):
        assert used == pytest.approx(side_m_s2 / GRAVITY_M_S2, rel=0.05)
    assert bend.front_load_share == pytest.approx(1.5453 / (1.3008 + 1.5453), abs=0.005)
    # Braking by 7 m/s² shifts h/L of that to the front: 0.55 m of 2.85 m.
    shift = 7.0 / GRAVITY_M_S2 * 0.55 / (1.3008 + 1.5453)
    assert braking.front_load_share == pytest.approx(bend.front_load_share + shift, rel=0.1)
    # Together the axles give it.
    share = braking.front_load_share
    given = share * braking.front_grip_used + (1.0 - share) * braking.rear_grip_used
    assert given == pytest.approx(7.0 / GRAVITY_M_S2, rel=0.1)


def test_on_half_of_the_friction_a_bend_takes_twice_the_share_of_it() -> None:
    disturbance = {"steps": [{"at_s": 0.0, "friction": 0.5}]}
    truths, states = truths_in_a_bend(381, disturbance=disturbance)
    side_m_s2 = states[190].speed_m_s * states[190].yaw_rate_rad_s
    for used in (truths[380].front_grip_used, truths[380].rear_grip_used):
        assert used == pytest.approx(2.0 * side_m_s2 / GRAVITY_M_S2, rel=0.05)


def test_a_car_at_rest_uses_no_grip() -> None:
    """Nothing pushes what its brakes hold, and nothing is divided by zero."""
    held = {"car": {"speed": [{"at_s": 0.0, "speed_m_s": 0.0}, {"at_s": 9.0, "speed_m_s": 0.0}]}}
    tested = link(ground_truth=True, **held, start_on_first_command=False)
    tested.tick_until(START_NS + 50 * PERIOD_NS)
    (*_, (_, truth)) = tested.messages(CarTruth)
    assert (truth.front_grip_used, truth.rear_grip_used) == (0.0, 0.0)


def test_where_it_is_sent_a_listener_computes_nothing() -> None:
    state, error = (motion_of(2.0, preview_curvature_1_m=0.02), error_of(0.1))
    listener = CgDeviation(PREVIEW_M)
    assert math.isnan(listener.on_message(error, 0.0))
    listener.on_message(state, 0.0)
    assert listener.on_message(error, 0.01) == pytest.approx(0.1 - 0.5 * PREVIEW_M**2 * 0.02)
    assert math.isnan(listener.on_message(error, math.nan))
    assert listener.on_message(message_with(GroundTruth, cg_deviation_m=0.03), math.nan) == 0.03
    assert math.isnan(listener.on_message(error, 0.02))
