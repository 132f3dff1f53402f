"""Live view of the controller: peer, modes, refused frames."""

from steer_by_wire.controller.node.newest_messages import plant_text
from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.dbc.codec.protection import protect
from steer_by_wire.dbc.messages import (
    CAN_IDS,
    DATA_IDS,
    OTHER_REVISION_TEXT,
    REVISIONS,
    VERSION,
    Freshness,
    LateralError,
    encode,
)
from steer_by_wire.runtime.frame import Frame
from tests.support.frames.made_messages import command_of, error_of, motion_of
from tests.support.nodes.controller_link import START_NS, Link, controller_settings


def link() -> Link:
    return Link(ControllerNode(controller_settings(), START_NS))


def states(tested: Link) -> tuple[str, str]:
    shown = tested.node.view(tested.now_ns).states
    assert not shown["failure"]
    return shown["mode"].split()[0].rstrip(":"), shown["plant"]


def test_a_lost_plant_is_shown_through_hold_and_stop_to_recovery() -> None:
    tested = link()
    assert states(tested) == ("WAITING", "")
    tested.drive(3, 0.1)
    assert states(tested) == ("ACTIVE", "plant present")
    tested.drive(8, None)
    assert states(tested) == ("HOLDING", "plant: LATERAL_ERROR stopped")
    tested.drive(15, None)
    assert states(tested) == ("SAFE_STOP", "plant: LATERAL_ERROR stopped")
    tested.drive(5, 0.1)
    assert states(tested) == ("ACTIVE", "plant present")


def silent_after_a_run(*, ends_with_plant: bool) -> Link:
    tested = Link(ControllerNode(controller_settings(), START_NS, ends_with_plant=ends_with_plant))
    tested.drive(20, 0.1)
    assert not tested.node.finished
    tested.drive(250, None)
    assert not tested.node.finished  # 2.5 s of silence
    tested.drive(150, None)
    return tested


def test_a_controller_can_end_with_its_plant() -> None:
    tested = silent_after_a_run(ends_with_plant=True)
    assert tested.node.finished
    assert tested.node.has_ended_with_plant
    report = tested.node.report()
    assert report["failure"] == ""
    assert (report["holds"], report["mode_s"]["safe_stop"]) == (0, 0.0)
    assert report["verdict"] == "no effect"  # as this link echoes no command


def test_a_stop_before_the_plant_ended_is_in_the_verdict() -> None:
    tested = Link(ControllerNode(controller_settings(), START_NS, ends_with_plant=True))
    tested.drive(20, 0.1)
    for _ in range(60):
        tested.deliver(motion_of(1.4))
        tested.drive(1, None)
    tested.drive(400, None)
    assert tested.node.has_ended_with_plant
    assert tested.node.report()["verdict"] == "safe stop"


def test_a_controller_that_ends_with_its_plant_waits_for_its_first_frame() -> None:
    tested = Link(ControllerNode(controller_settings(), START_NS, ends_with_plant=True))
    tested.drive(1000, None)
    assert not tested.node.finished


def test_what_happens_without_the_plant_is_said() -> None:
    stale = (Freshness.STALE,) * 3
    assert plant_text(stale, ends_with_plant=False).endswith(
        "waiting for it until Ctrl-C (--exit-with-plant ends by itself)"
    )
    assert plant_text(stale, ends_with_plant=True).endswith("when the command is back at zero")


def test_refused_frames_are_shown_by_cause() -> None:
    tested = link()
    tested.drive(3, 0.1)
    can_id, data, flags = encode(error_of(), 3)
    for bad in (bytes([data[0] ^ 1, *data[1:]]), data[:-1], data[:-1]):
        tested.node.on_frame(Frame(can_id, bad, flags), tested.now_ns)
    counts = tested.node.view(tested.now_ns).counts
    assert counts["frames rejected, bad_crc"] == 1
    assert counts["frames rejected, wrong_length"] == 2


def test_a_plant_of_another_revision_of_the_dbc_is_said_in_one_line() -> None:
    tested = link()
    payload = bytearray(encode(error_of(0.1), 0).data)
    protect(payload, DATA_IDS[LateralError] ^ REVISIONS[0])
    assert tested.node.view(START_NS).states["revision"] == ""
    tested.node.on_frame(Frame(CAN_IDS[LateralError], bytes(payload)), START_NS)
    assert tested.node.view(START_NS).states["revision"] == OTHER_REVISION_TEXT
    assert f"than this one's {VERSION}: use one release" in OTHER_REVISION_TEXT


def test_a_second_sender_is_shown_by_the_message_it_sends() -> None:
    tested = link()
    tested.drive(3, 0.1)
    assert not tested.node.view(tested.now_ns).states["second sender"]
    own = encode(command_of(0.1, 7), 7)
    tested.node.on_frame(own, tested.now_ns)
    shown = tested.node.view(tested.now_ns).states["second sender"]
    assert shown.startswith("second sender of STEERING_COMMAND: ")
