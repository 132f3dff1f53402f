"""Frames to the plant node that nobody should have sent, and values its own cannot carry."""

import math

import pytest

from steer_by_wire.dbc.messages import (
    CAN_IDS,
    Decoded,
    Direction,
    LatencyConfig,
    LatencyModel,
    LateralError,
    Mode,
    PlantStatus,
    SteeringCommand,
    VehicleState,
    decode,
    encode,
    encode_not_available,
    limits,
)
from steer_by_wire.plant_emulator.node.node import PlantNode
from steer_by_wire.runtime.frame import EXTENDED, Frame
from tests.support.nodes.plant_link import MS_NS, PERIOD_NS, START_NS, Link, link, plant_settings

# Frames nobody should have sent


A_CONFIG = LatencyConfig(Direction.BOTH, LatencyModel.CONSTANT, 0.0, 0.0, 0.0)


def test_bad_frames_are_counted_by_cause_and_change_nothing() -> None:
    def run(with_bad: bool) -> Link:
        tested = link()
        for step in range(30):
            now_ns = START_NS + step * PERIOD_NS
            tested.command(now_ns, 0.01 * step)
            good = encode(SteeringCommand(0.01 * step, step, Mode.ACTIVE), step)
            late = step - 6 if step >= 6 else step + 250
            if with_bad and step % 10 == 5:
                bad = (
                    good._replace(data=good.data[:-1] + b"\xff"),
                    good._replace(data=good.data[:5]),
                    good._replace(flags=EXTENDED),
                    good,  # the command before, again
                    encode(SteeringCommand(0.01 * (step - 6), late, Mode.ACTIVE), late),
                    encode(SteeringCommand(0.5, 0, Mode.ACTIVE), (step + 110) % 256),
                    encode_not_available(SteeringCommand(0.5, 0, Mode.ACTIVE), step + 1),
                    Frame(CAN_IDS[LateralError], bytes(8)),  # only the plant sends it, and no such
                    Frame(0x7FF, b""),
                )
                for frame in bad:
                    tested.node.on_frame(frame, now_ns)
            tested.tick_until(now_ns)
        return tested

    clean, disturbed = run(False), run(True)
    assert disturbed.node.samples == clean.node.samples
    assert disturbed.node.report()["rejected"] == {
        "bad_crc": 3,
        "wrong_length": 3,
        "wrong_format": 3,
        "repeated": 3,
        "out_of_order": 3,
        "too_far": 3,
        "not_available": 3,
        "own_identifier": 3,
    }
    assert disturbed.node.report()["accepted"] == 30
    assert disturbed.last(PlantStatus).rejected == 16  # at 200 ms, 8 at each of 2 steps
    assert clean.node.report()["rejected"] == {}


def test_commands_that_never_came_are_counted() -> None:
    tested = link()
    tested.command(START_NS, 0.1)
    tested.counter += 4
    tested.command(START_NS + PERIOD_NS, 0.1)
    assert tested.node.report()["lost_on_the_bus"] == 4


# What a signal cannot carry


def test_beyond_its_range_the_lateral_error_is_not_available_and_comes_back() -> None:
    tested = link(vehicle={"speed_m_s": 100 / 3.6}, path={"kind": "circle", "radius_m": 50})
    tested.command(START_NS, 0.0)
    tested.tick_until(START_NS + 1000 * PERIOD_NS)
    largest_m = limits(LateralError)["lateral_error_m"].maximum
    errors = [
        (sample, decode(frame))
        for sample, frame in zip(
            tested.node.samples,
            [f for _, f in tested.frames if f.can_id == CAN_IDS[LateralError]],
            strict=True,
        )
    ]
    beyond = [decoded for s, decoded in errors if abs(s.lateral_error_m) > largest_m]
    within = [decoded for s, decoded in errors if abs(s.lateral_error_m) <= largest_m]
    assert len(beyond) > 100
    assert {str(decoded) for decoded in beyond} == {"not_available"}
    assert all(isinstance(decoded, Decoded) for decoded in within)
    assert tested.node.report()["not_available"] == len(beyond)


def test_the_heading_error_is_an_angle_of_one_turn() -> None:
    tested = link(start_on_first_command=False, safety={"fallback": "keep"})
    tested.command(START_NS, 0.5)
    tested.tick_until(START_NS + 1800 * PERIOD_NS)
    true = [sample.heading_error_rad for sample in tested.node.samples]
    assert max(true) > 3.5
    sent = [message.heading_error_rad for _, message in tested.messages(LateralError)]
    for a, b in zip(true, sent, strict=True):
        assert math.cos(a - b) == pytest.approx(1.0, abs=1e-6)


def test_what_is_sent_as_the_end_of_its_range_is_counted() -> None:
    tested = link(vehicle={"speed_m_s": 250 / 3.6}, path={"kind": "circle", "radius_m": 5})
    tested.command(START_NS, 0.0)
    tested.tick_until(START_NS)
    assert tested.last(VehicleState).preview_curvature_1_m == pytest.approx(0.2)
    assert tested.node.report()["clamped"] == 0
    tested.configure(
        START_NS, LatencyConfig(Direction.DOWNLINK, LatencyModel.CONSTANT, 6.0, 0.0, 0.0)
    )
    tested.command(START_NS + MS_NS, 0.0)
    tested.tick_until(START_NS + 10 * PERIOD_NS)
    largest_s = limits(PlantStatus)["downlink_latency_s"].maximum
    assert tested.last(PlantStatus).downlink_latency_s == pytest.approx(largest_s)
    assert tested.node.report()["clamped"] == 1


def test_samples_are_bounded_and_the_figures_are_not() -> None:
    tested = Link(plant_settings(start_on_first_command=False))
    tested.node = PlantNode(tested.settings, START_NS, samples_max=5)
    tested.tick_until(START_NS + 20 * PERIOD_NS)
    assert len(tested.node.samples) == 5
    assert tested.node.report()["samples"] == 21
    assert tested.node.report()["lateral_error_final_m"] != 0.0
