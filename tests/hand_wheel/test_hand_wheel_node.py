"""The hand wheel as a node: what it sends, what it feels, and what it does without the road."""

from typing import TypeVar

import pytest

from steer_by_wire.dbc.messages import (
    Decoded,
    HandWheelFeedback,
    HandWheelState,
    HandWheelStatus,
    Message,
    Mode,
    SecondSender,
    SteeredBy,
    SteeringForce,
    SteeringStatus,
    SteeringStatusCode,
    decode,
    encode,
)
from steer_by_wire.hand_wheel.node import HandWheelNode
from steer_by_wire.hand_wheel.settings import HandWheelSettings
from tests.support.frames.made_messages import message_with

M = TypeVar("M", bound=Message)
MS_NS = 1_000_000
START_NS = 5_000_011
FORCE_N = -100.0
"""To the right, as in a left turn."""


class Road:
    """A hand wheel whose road the test makes, a message each cycle."""

    def __init__(self, **tables: object) -> None:
        self.settings = HandWheelSettings.model_validate({"cycle_ms": 5.0, **tables})
        self.node = HandWheelNode(self.settings, START_NS)
        self.sent: list[tuple[int, Message]] = []
        self.counters: dict[type, int] = {}
        self.now_ns = START_NS

    def receive(self, message: Message) -> None:
        counter = self.counters.get(type(message), 0)
        self.counters[type(message)] = counter + 1
        assert self.node.on_frame(encode(message, counter % 256), self.now_ns) == ()

    def run(self, milliseconds: int, *messages: Message) -> None:
        end_ns = self.now_ns + milliseconds * MS_NS
        while self.node.deadline_ns < end_ns:
            self.now_ns = self.node.deadline_ns
            for message in messages:
                self.receive(message)
            for frame in self.node.on_tick(self.now_ns):
                got = decode(frame)
                assert isinstance(got, Decoded)
                self.sent.append((self.now_ns, got.message))
        self.now_ns = end_ns

    def last(self, kind: type[M]) -> M:
        return next(message for _, message in reversed(self.sent) if isinstance(message, kind))

    @property
    def status(self) -> HandWheelStatus:
        return self.last(HandWheelStatus)


def force(newtons: float = FORCE_N) -> SteeringForce:
    return message_with(SteeringForce, rack_force_n=newtons)


def orders(steered_by: SteeredBy, answered: int = 0) -> HandWheelFeedback:
    return message_with(
        HandWheelFeedback, steering_ratio=16.0, answered_state=answered, steered_by=steered_by
    )


def test_states_come_each_cycle_and_the_status_each_100_ms() -> None:
    road = Road()
    road.run(500)
    times = [now for now, message in road.sent if isinstance(message, HandWheelState)]
    assert times == [START_NS + 5 * MS_NS * k for k in range(100)]
    statuses = [now for now, message in road.sent if isinstance(message, HandWheelStatus)]
    assert statuses == [START_NS + 100 * MS_NS * k for k in range(5)]
    assert road.status.mode is Mode.WAITING


def test_the_driver_holds_against_the_roads_torque() -> None:
    road = Road(wheel={"friction_n_m": 0.0})
    road.run(3000, force())
    assert road.status.mode is Mode.ACTIVE
    torque = road.settings.feedback_params.force_n_m_n * FORCE_N
    assert road.status.applied_torque_n_m == pytest.approx(torque, abs=0.02)
    state = road.last(HandWheelState)
    assert state.driver_torque_n_m == pytest.approx(-torque, abs=0.02)
    assert state.hand_wheel_angle_rad == pytest.approx(torque / 5.0, abs=1e-3)  # light grip


def test_a_silent_road_is_held_and_fades_into_local_damping() -> None:
    road = Road(driver={"grip": "firm"})
    road.run(1000, force())
    felt = road.status.applied_torque_n_m
    road.run(170)
    assert road.node.report()["mode"] == "holding"
    road.run(300)
    assert road.node.report()["mode"] == "safe_stop"
    half = road.status.applied_torque_n_m
    assert 0.3 < half / felt < 0.8
    road.run(500)
    assert road.status.applied_torque_n_m == pytest.approx(0.0, abs=0.02)
    road.run(20, force())  # four of the five messages that it takes
    assert road.node.report()["mode"] == "safe_stop"
    road.run(5, force())
    assert road.node.report()["mode"] == "active"
    road.run(575, force())
    assert road.status.mode is Mode.ACTIVE
    assert road.status.applied_torque_n_m == pytest.approx(felt, abs=0.02)


def test_a_law_chosen_later_knows_when_its_road_was_heard() -> None:
    road = Road(feedback={"law": "model"})
    road.run(100, force())
    for law, mode in {"rack_force": "active", "spring": "holding"}.items():
        road.node.feel({"law": law})
        road.run(5)
        assert road.node.report()["mode"] == mode


def test_damaged_and_repeated_frames_are_refused_and_counted() -> None:
    road = Road()
    road.run(100, force())
    good = encode(force(), road.counters[SteeringForce] % 256)
    damaged = good._replace(data=good.data[:-1] + bytes([good.data[-1] ^ 1]))
    road.node.on_frame(damaged, road.now_ns)
    road.node.on_frame(good, road.now_ns)
    road.node.on_frame(good, road.now_ns)
    road.run(101)
    assert road.node.report()["rejected"] == {"bad_crc": 1, "repeated": 1}
    assert road.status.rejected == 2


def test_another_hand_wheel_on_the_bus_is_reported() -> None:
    road = Road()
    road.run(200, force())
    road.node.on_frame(encode(message_with(HandWheelState), 77), road.now_ns)
    road.run(100, force())
    assert road.status.second_sender is SecondSender.OWN
    assert road.node.report()["second_senders"] == ["HAND_WHEEL_STATE"]


def test_while_the_law_steers_the_wheel_follows_the_road_wheels() -> None:
    road = Road(driver={"grip": "hands_off"})
    status = message_with(SteeringStatus, wheel_angle_rad=0.05, status=SteeringStatusCode.APPLYING)
    road.run(2000, force(), status, orders(SteeredBy.LAW))
    angle = road.last(HandWheelState).hand_wheel_angle_rad
    assert angle == pytest.approx(16.0 * 0.05, abs=0.05)
    # Without a controller the driver steers again, and feels the road.
    road.run(1500, force(), status)
    assert road.node.report()["steered_by"] == "driver"
    assert road.status.applied_torque_n_m < 0.0


def test_the_round_trip_is_known_from_the_answered_counter() -> None:
    road = Road()
    road.run(20)
    road.now_ns += 3 * MS_NS
    road.receive(orders(SteeredBy.DRIVER, answered=3))  # sent 8 ms ago
    trip = road.node.report()["round_trip"]
    assert trip["samples"] == 1
    assert trip["max_s"] == pytest.approx(0.008)


def test_a_wheel_too_slow_for_its_cycle_fades_out_and_ends() -> None:
    road = Road(overruns={"overruns_max": 3}, driver={"grip": "firm"})
    road.run(300, force())
    for _ in range(300):
        road.now_ns += 12 * MS_NS
        road.receive(force())
        road.node.on_tick(road.now_ns)
    report = road.node.report()
    assert road.node.finished
    assert "overran" in report["failure"]
    assert report["mode"] == "safe_stop"
