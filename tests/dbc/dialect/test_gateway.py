"""A node behind a gateway: the car's frames on their cycles, and what the car refuses stays out."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cantools.database
import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.closed_loop.pair.virtual_pair import make_virtual_pair, run_virtual_nodes
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc.dialect.dialect import Dialect, read_dialect
from steer_by_wire.dbc.dialect.gateway import HOLD_NS, Gateway
from steer_by_wire.dbc.messages import (
    CAN_IDS,
    Decoded,
    LateralError,
    Mode,
    SteeringStatus,
    SteeringStatusCode,
    decode,
    encode,
)
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.frame import EXTENDED, Frame
from steer_by_wire.runtime.node import NEVER_NS, NS_PER_MS, View
from steer_by_wire.runtime.node.end import End
from tests.support.frames.made_messages import command_of, error_of, message_with, motion_of

CAR = Path(__file__).with_name("my_car.toml")
DATABASE: Any = cantools.database.load_file(CAR.with_suffix(".dbc"))
LANE_ID = DATABASE.get_message_by_name("LANE").frame_id


class Recorder:
    """A node that keeps what it is handed, and sends what it is told to."""

    finished = False

    def __init__(self) -> None:
        self.deadline_ns = 0
        self.to_send: list[Frame] = []
        self.got: list[Frame] = []
        self.refused = 0

    def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:  # noqa: ARG002
        self.got.append(frame)
        return ()

    def on_tick(self, now_ns: int) -> Sequence[Frame]:  # noqa: ARG002
        self.deadline_ns = NEVER_NS
        sent, self.to_send = self.to_send, []
        return sent

    def on_unauthenticated(self) -> None:
        self.refused += 1

    def view(self, now_ns: int) -> View:  # noqa: ARG002
        return View({}, {}, "")

    def report(self) -> Mapping[str, Any]:
        return {"own": 1, "second_senders": []}

    @property
    def messages(self) -> list[Any]:
        """What it was handed, decoded."""
        decoded = [decode(frame) for frame in self.got]
        assert all(isinstance(one, Decoded) for one in decoded)
        return [one.message for one in decoded if isinstance(one, Decoded)]


def behind(end: str) -> tuple[Recorder, Gateway[Recorder]]:
    node = Recorder()
    return node, Gateway(node, read_dialect(CAR), end, 0)


def request(angle_deg: float, counter: int, active: int = 1, spoilt: int = 0) -> Frame:
    """Return a request of the car, made without the code under test."""
    values = {"ANGLE_REQUEST": angle_deg, "REQUEST_ACTIVE": active, "TORQUE_MAX": 10.0}
    values |= {"REQUEST_COUNTER": counter % 16, "REQUEST_CHECKSUM": 0}
    data = bytearray(DATABASE.encode_message("STEER_REQUEST", values))
    data[7] = (sum(data) + 1 + len(data) + spoilt) % 256  # 1: the bytes of 0x100
    return Frame(0x100, bytes(data))


def test_a_request_becomes_a_command() -> None:
    node, gateway = behind(End.PLANT)
    for counter, angle_deg in enumerate((0.0, 5.0, -0.5)):
        gateway.on_frame(request(angle_deg, counter), counter * 10 * NS_PER_MS)
    steers = [one.steer_rad for one in node.messages]
    assert steers == pytest.approx([0.0, 0.005818, -0.000582], abs=5e-6)
    assert [one.command_counter for one in node.messages] == [0, 1, 2]
    assert {one.mode for one in node.messages} == {Mode.ACTIVE}
    figures = {"sent": 0, "accepted": 3, "refused": {}}
    assert gateway.report() == {"own": 1, "second_senders": [], "dialect": figures}


@pytest.mark.parametrize(
    ("frame", "cause"),
    [
        (request(0.0, 1, spoilt=1), "bad checksum"),
        (request(0.0, 0), "repeated counter"),
        (request(0.0, 1, active=0), "not engaged"),
        (request(0.0, 1, active=2), "not engaged"),
        (request(7.0, 1), "too fast"),
        (request(1600.0, 1), "out of range"),
        (Frame(0x100, bytes(3)), "wrong length"),
    ],
)
def test_what_the_car_would_refuse_is_counted_and_stays_out(frame: Frame, cause: str) -> None:
    node, gateway = behind(End.PLANT)
    gateway.on_frame(request(0.0, 0), 0)
    gateway.on_frame(frame, 10 * NS_PER_MS)
    assert len(node.got) == node.refused == 1
    assert gateway.report()["dialect"]["refused"] == {cause: 1}
    assert gateway.view(0).counts == {f"STEER_REQUEST refused, {cause}": 1}


@pytest.mark.parametrize("ahead", range(16))
@pytest.mark.parametrize("period_ms", [10, 7, 20, 100])
def test_a_second_sender_is_noticed_by_the_car_s_own_counter(ahead: int, period_ms: int) -> None:
    _, gateway = behind(End.PLANT)
    frames = [(10 * n, request(1.0, n)) for n in range(300)]
    for now_ms, frame in frames[:100]:
        gateway.on_frame(frame, now_ms * NS_PER_MS)
    assert gateway.second_senders == []
    others = [(1003 + period_ms * n, request(2.0, n + ahead)) for n in range(300)]
    for now_ms, frame in sorted(frames[100:] + others):
        if now_ms <= 1003 + 1000:
            gateway.on_frame(frame, now_ms * NS_PER_MS)
    assert gateway.second_senders == ["STEER_REQUEST"]
    assert gateway.report()["second_senders"] == ["STEER_REQUEST"]
    assert gateway.view(0).states["second sender"].startswith("second sender of STEER_REQUEST")


def test_doubled_frames_and_a_restart_are_no_second_sender() -> None:
    _, gateway = behind(End.PLANT)
    for number in range(400):
        frame = request(1.0, number + 5 * (number > 200))
        gateway.on_frame(frame, 10 * number * NS_PER_MS)
        gateway.on_frame(frame, (10 * number + 3) * NS_PER_MS)
    assert gateway.second_senders == []


def test_a_frame_that_only_this_end_sends_is_noticed_unless_it_is_an_echo() -> None:
    node, gateway = behind(End.CONTROLLER)
    node.to_send = [encode(command_of(0.1), 0)]
    (sent,) = gateway.on_tick(0)
    gateway.on_frame(sent, NS_PER_MS)
    assert gateway.second_senders == []
    gateway.on_frame(request(1.0, 7), 2 * NS_PER_MS)
    assert gateway.second_senders == ["STEER_REQUEST"]


@given(st.binary(max_size=8), st.sampled_from([0, EXTENDED]), st.sampled_from([0x100, LANE_ID, 7]))
def test_any_bytes_are_taken_or_counted(data: bytes, flags: int, can_id: int) -> None:
    for end in (End.PLANT, End.CONTROLLER):
        node, gateway = behind(end)
        gateway.on_frame(Frame(can_id, data, flags), 0)
        figures = gateway.report()["dialect"]
        assert len(node.messages) <= 3
        assert figures["accepted"] + sum(figures["refused"].values()) <= 1


def test_measurements_leave_as_the_car_says_them() -> None:
    node, gateway = behind(End.PLANT)
    error, state = (
        message_with(LateralError, lateral_error_m=0.125, heading_error_rad=-0.02),
        motion_of(10.0, 0.1, 0.004),
    )
    status = message_with(
        SteeringStatus, wheel_angle_rad=0.05, applied_counter=3, status=SteeringStatusCode.APPLYING
    )
    node.to_send = [encode(one, 0) for one in (error, state, status)]
    sent = {frame.can_id: frame for frame in gateway.on_tick(0)}
    said = {
        name: value
        for frame in sent.values()
        for name, value in DATABASE.decode_message(frame.can_id, frame.data).items()
    }
    assert said["HAND_WHEEL_ANGLE"] == pytest.approx(0.05 * 15.0 * 57.29578, abs=0.05)
    assert said["VEHICLE_SPEED"] == pytest.approx(36.0, abs=0.02)
    assert said["YAW_RATE"] == pytest.approx(5.73, abs=0.006)
    assert (said["LATERAL_OFFSET"], said["HEADING"]) == (-0.125, 0.02)
    assert said["CURVATURE"] == pytest.approx(0.004, abs=2e-6)
    assert str(said["GEAR"]) == "D"
    assert sent[LANE_ID].flags == EXTENDED


def test_each_message_keeps_its_cycle_while_its_values_are_new() -> None:
    node, gateway = behind(End.PLANT)
    node.to_send = [encode(error_of(), 0), encode(motion_of(10.0), 0)]
    times: dict[int, list[int]] = {}
    while gateway.deadline_ns <= 2 * HOLD_NS:
        now_ns = gateway.deadline_ns
        for frame in gateway.on_tick(now_ns):
            times.setdefault(frame.can_id, []).append(now_ns)
    assert times == {
        0x201: list(range(0, HOLD_NS + 1, 20 * NS_PER_MS)),
        LANE_ID: list(range(0, HOLD_NS + 1, 10 * NS_PER_MS)),
    }  # nothing was said of the wheel


def driven(dialect: Dialect | None) -> tuple[float, set[int], list[Mapping[str, Any]]]:
    """Return the error of a run, the identifiers on its bus, and the reports of both ends."""
    settings = PlantSettings(duration_s=5.0), controller_preset("practical_pd_ddob")
    pair = make_virtual_pair(*settings)
    nodes: list[Any] = [pair.edge, pair.controller]
    if dialect is not None:
        ends = (End.PLANT, End.CONTROLLER)
        nodes = [Gateway(node, dialect, end, 0) for node, end in zip(nodes, ends, strict=True)]
    seen: set[int] = set()

    def on_wire(_time_ns: int, _sender: int, frame: Frame) -> None:
        seen.add(frame.can_id)

    run_virtual_nodes(nodes[0], nodes[1], None, None, lambda: False, on_wire)
    error_m = pair.plant.report()["preview_rms_m"]
    return error_m, seen, [node.report() for node in nodes]


def test_both_nodes_hold_the_path_in_the_dialect_as_they_do_without() -> None:
    error_m, seen, reports = driven(read_dialect(CAR))
    assert seen == {0x100, 0x200, 0x201, LANE_ID}
    assert [report["dialect"]["refused"] for report in reports] == [{}, {}]
    assert all(report["dialect"]["accepted"] > 490 for report in reports)
    own_error_m, own_seen, _ = driven(None)
    assert CAN_IDS[LateralError] in own_seen
    assert error_m == pytest.approx(own_error_m, abs=5e-4)
