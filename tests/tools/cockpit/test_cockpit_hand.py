"""The visitor's hand on the bus, and the ghost of the car without delay."""

import math
from pathlib import Path

import pytest

from steer_by_wire.dbc.messages import Mode, SteeringCommand, encode
from steer_by_wire.plant_emulator.settings import plant_preset
from steer_by_wire.tools.cockpit.ghost import Ghost
from steer_by_wire.tools.cockpit.hand import PERIOD_NS, RELEASED_NS, HandFile, HandNode
from steer_by_wire.tools.cockpit.signals import ROW_PERIOD_S

START_NS = 7 * PERIOD_NS + 3


def test_a_hand_sends_its_newest_angle_each_period_and_nothing_once_it_is_gone(
    tmp_path: Path,
) -> None:
    hand = HandFile(tmp_path / "hand")
    node = HandNode(HandFile(tmp_path / "hand"), START_NS)  # as another process maps it
    assert node.on_tick(START_NS) == ()
    for number in range(3):
        hand.write(0.1 * (number + 1), node.deadline_ns)
        command = SteeringCommand(0.1 * (number + 1), number, Mode.ACTIVE)
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
