"""A hand wheel that steers the plant in place of the controller's commands."""

import pytest

from steer_by_wire.dbc.messages import (
    HandWheelFeedback,
    HandWheelState,
    Message,
    PlantStatus,
    SafetyState,
    SteeredBy,
    SteeringStatus,
    SteeringStatusCode,
    encode,
)
from tests.support.frames.made_messages import message_with
from tests.support.nodes.plant_link import MS_NS, START_NS, Link, link

LATENCY_MS = 30
LAW = message_with(HandWheelFeedback, steering_ratio=20.0, steered_by=SteeredBy.LAW)
LATE = {"downlink": {"model": "constant", "mean_s": LATENCY_MS / 1e3}}


def driven(milliseconds: range, angle_rad: float, tested: Link, period_ms: int = 2) -> None:
    for ms in milliseconds[::period_ms]:
        state = message_with(HandWheelState, hand_wheel_angle_rad=angle_rad)
        send(tested, state, START_NS + ms * MS_NS, ms // period_ms)


def send(tested: Link, message: Message, now_ns: int, counter: int) -> None:
    tested.tick_until(now_ns - 1)
    assert tested.node.on_frame(encode(message, counter % 256), now_ns) == ()


def plant(**tables: object) -> Link:
    return link(hand_wheel={"steering_ratio": 20.0}, latency=LATE, **tables)


def test_the_driver_steers_late_until_the_controller_decides() -> None:
    tested = plant()
    driven(range(100), 0.4, tested)
    tested.command(START_NS + 100 * MS_NS, -0.01)
    tested.tick_until(START_NS + 150 * MS_NS)
    angles = {now: m.wheel_angle_rad for now, m in tested.messages(SteeringStatus)}
    assert angles[START_NS + 20 * MS_NS] == 0.0
    assert angles[START_NS + 40 * MS_NS] == pytest.approx(0.02)
    assert tested.last(SteeringStatus).status is SteeringStatusCode.DRIVER_STEERS
    law = LAW._replace(steering_ratio=10.0)
    send(tested, law, START_NS + 151 * MS_NS, 0)
    tested.command(START_NS + 160 * MS_NS, -0.01)
    driven(range(162, 240), 0.4, tested)
    status = tested.last(SteeringStatus)
    assert status.wheel_angle_rad == pytest.approx(-0.01)
    assert status.status is SteeringStatusCode.APPLYING
    send(tested, law._replace(steered_by=SteeredBy.DRIVER), START_NS + 241 * MS_NS, 1)
    driven(range(242, 320), 0.4, tested)
    assert tested.last(SteeringStatus).wheel_angle_rad == pytest.approx(0.04)


def test_a_hand_wheel_that_falls_silent_is_held_then_straightened() -> None:
    tested = plant()
    driven(range(300), 0.4, tested)
    tested.tick_until(START_NS + 500 * MS_NS)
    assert tested.last(PlantStatus).safety is SafetyState.HOLDING
    tested.tick_until(START_NS + 1500 * MS_NS)
    assert tested.last(PlantStatus).safety is SafetyState.FALLBACK
    assert tested.last(SteeringStatus).wheel_angle_rad == 0.0


def test_the_driver_steers_once_the_controller_is_silent() -> None:
    tested = plant()
    for ms in range(0, 200, 10):
        send(tested, LAW, START_NS + ms * MS_NS, ms // 10)
        tested.command(START_NS + ms * MS_NS, 0.01)
    driven(range(200, 600), 0.4, tested)
    assert tested.last(SteeringStatus).wheel_angle_rad == pytest.approx(0.01)
    driven(range(600, 1400), 0.4, tested)
    assert tested.last(SteeringStatus).wheel_angle_rad == pytest.approx(0.02)
    assert tested.last(PlantStatus).safety is SafetyState.NORMAL


def test_without_its_table_the_plant_ignores_a_hand_wheel() -> None:
    tested = link()
    tested.command(START_NS, 0.01)
    driven(range(1, 100), 0.4, tested)
    assert tested.last(SteeringStatus).wheel_angle_rad == pytest.approx(0.01)
    assert tested.node.report()["rejected"] == {}
