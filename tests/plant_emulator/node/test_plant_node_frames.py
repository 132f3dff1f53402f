"""Frames to the plant node that nobody should have sent, and values its own cannot carry."""

import math

import pytest

from steer_by_wire.dbc.messages import (
    CAN_IDS,
    Decoded,
    Direction,
    LateralError,
    PlantStatus,
    VehicleState,
    decode,
    limits,
)
from tests.support.frames.made_messages import latency_of
from tests.support.nodes.plant_link import MS_NS, PERIOD_NS, START_NS, link

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
    tested.configure(START_NS, latency_of(Direction.DOWNLINK, 6.0))
    tested.command(START_NS + MS_NS, 0.0)
    tested.tick_until(START_NS + 10 * PERIOD_NS)
    largest_s = limits(PlantStatus)["downlink_latency_s"].maximum
    assert tested.last(PlantStatus).downlink_latency_s == pytest.approx(largest_s)
    assert tested.node.report()["clamped"] == 1
