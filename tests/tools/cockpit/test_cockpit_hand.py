"""The visitor's hand on the bus, and the two ghosts beside the car."""

import math
from pathlib import Path

import pytest

from steer_by_wire.dbc.messages import (
    Direction,
    DisturbanceConfig,
    encode,
)
from steer_by_wire.plant_emulator.settings import plant_preset
from steer_by_wire.runtime.node import NS_PER_S
from steer_by_wire.tools.cockpit.ghost import Ghost
from steer_by_wire.tools.cockpit.hand import PERIOD_NS, RELEASED_NS, HandFile, HandNode
from steer_by_wire.tools.cockpit.predictor_ghost import PredictorGhost
from steer_by_wire.tools.cockpit.scenario import lane_settings, scenarios
from steer_by_wire.tools.cockpit.signals import ROW_PERIOD_S
from tests.support.frames.made_messages import command_of, latency_of, message_with

START_NS = 7 * PERIOD_NS + 3


def test_a_hand_sends_its_newest_angle_each_period_and_nothing_once_it_is_gone(
    tmp_path: Path,
) -> None:
    hand = HandFile(tmp_path / "hand")
    node = HandNode(HandFile(tmp_path / "hand"), START_NS)  # as another process maps it
    assert node.on_tick(START_NS) == ()
    for number in range(3):
        hand.write(0.1 * (number + 1), node.deadline_ns)
        command = command_of(0.1 * (number + 1), number)
        assert node.on_tick(node.deadline_ns) == (encode(command, number),)
    written_ns = START_NS + 3 * PERIOD_NS
    assert node.on_tick(written_ns + RELEASED_NS - 1)
    assert node.on_tick(written_ns + RELEASED_NS) == ()


def test_ticks_that_were_missed_are_left_out_and_the_phase_is_kept(tmp_path: Path) -> None:
    hand = HandFile(tmp_path / "hand")
    node = HandNode(hand, START_NS)
    hand.write(0.2, START_NS)
    assert len(node.on_tick(START_NS + 5 * PERIOD_NS + 1)) == 1
    assert node.deadline_ns == START_NS + 6 * PERIOD_NS


def test_the_ghost_turns_by_what_the_delay_withholds_and_forgets_it() -> None:
    vehicle = plant_preset("highway_nominal").vehicle
    v, mass_kg = vehicle.speed_m_s, vehicle.virtual_mass_kg
    front_m, rear_m = vehicle.front_axle_distance_m, vehicle.rear_axle_distance_m
    front, rear = vehicle.front_cornering_stiffness_n_rad, vehicle.rear_cornering_stiffness_n_rad
    base_m = front_m + rear_m
    understeer = mass_kg * (rear_m * rear - front_m * front) / (front * rear * base_m)
    yaw_gain_1_s = v / (base_m + understeer * v * v)  # steady, by the textbook
    ghost, delay_s, steer_rad = Ghost(vehicle), 0.24, 0.01

    def heading_after(seconds: float, ahead_rad: float) -> float:
        steps = round(seconds / ROW_PERIOD_S)
        return [ghost.step(ahead_rad, 0.0) for _ in range(steps)][-1].heading_rad

    assert ghost.step(0.3, 0.3) == (0.0, 0.0)
    assert ghost.step(math.nan, 0.3) == (0.0, 0.0)
    heading_after(delay_s, steer_rad)
    turned_rad = heading_after(1.0, 0.0)
    assert turned_rad == pytest.approx(
        yaw_gain_1_s * steer_rad * delay_s * math.exp(-1.12 / 5), 0.05
    )
    assert heading_after(5.0, 0.0) == pytest.approx(turned_rad / math.e, 0.05)


def test_the_predictors_ghost_starts_with_the_visitor_and_meets_the_same_delay_and_gust() -> None:
    (round_,) = (one for one in scenarios() if one.title == "Drive it: no delay")
    (lane,) = lane_settings(round_)
    quick, slow = PredictorGhost(lane.plant), PredictorGhost(lane.plant)
    assert math.isnan(quick.at(9 * NS_PER_S).lateral_m)
    for car in (quick, slow):
        car.begin(9 * NS_PER_S)
        car.begin(10 * NS_PER_S)  # by the second command
    late = latency_of(Direction.DOWNLINK, 0.4)
    slow.configure(encode(late, 0), 10 * NS_PER_S)
    for car in (quick, slow):
        assert abs(car.at(11 * NS_PER_S).lateral_m) < 1e-3  # on the straight of the beginning
        car.configure(
            encode(message_with(DisturbanceConfig, side_force_n=1500.0), 0), 11 * NS_PER_S
        )
    assert 0.005 < quick.at(12 * NS_PER_S).lateral_m < slow.at(12 * NS_PER_S).lateral_m < 0.2
