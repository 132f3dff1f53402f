"""Which of the frames it receives a node accepts."""

from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.dbc.codec.sequence_and_second_sender import SequenceResult, SequenceRule
from steer_by_wire.dbc.messages import (
    CAN_IDS,
    Direction,
    LatencyConfig,
    LatencyModel,
    LateralError,
    Mode,
    Rejection,
    SteeringCommand,
    SteeringStatus,
    SteeringStatusCode,
    encode,
)
from steer_by_wire.dbc.reception import Reception
from steer_by_wire.runtime.frame import EXTENDED, Frame
from steer_by_wire.runtime.node import NS_PER_MS

COMMAND = SteeringCommand(0.25, 7, Mode.ACTIVE)
CONFIG = LatencyConfig(Direction.BOTH, LatencyModel.CONSTANT, 0.01, 0.0, 0.0)


def reception(lead_ms: int = 90, resync_run: int = 3) -> Reception:
    rule = SequenceRule(lead_ms * NS_PER_MS, resync_run)
    return Reception((SteeringCommand, LateralError, LatencyConfig), rule)


def test_a_good_frame_is_its_message() -> None:
    tested = reception()
    assert tested.take(encode(COMMAND, 200)) == COMMAND
    assert (tested.accepted, tested.rejected, tested.lost) == (1, {}, 0)


def test_what_is_not_received_here_is_nobodys_business() -> None:
    tested = reception()
    status = SteeringStatus(0.0, 0, SteeringStatusCode.APPLYING)
    assert tested.take(encode(status, 0)) is None
    assert tested.take(Frame(0x7FF, b"")) is None
    assert (tested.accepted, tested.rejected) == (0, {})


def test_every_cause_of_refusal_has_its_count() -> None:
    tested = reception()
    good = encode(COMMAND, 5)
    tested.take(good)
    for frame, cause in (
        (good, SequenceResult.REPEATED),
        (encode(COMMAND, 4), SequenceResult.OUT_OF_ORDER),
        (encode(COMMAND, 16), SequenceResult.TOO_FAR),
        (good._replace(data=good.data[:-1] + b"\xee"), Rejection.BAD_CRC),
        (good._replace(data=good.data[:-1] + b"\xee"), Rejection.BAD_CRC),
        (good._replace(data=b""), Rejection.WRONG_LENGTH),
        (good._replace(flags=EXTENDED), Rejection.WRONG_FORMAT),
    ):
        assert tested.take(frame) is cause
    assert tested.accepted == 1
    assert tested.rejected == {
        "bad_crc": 2,
        "out_of_order": 1,
        "repeated": 1,
        "too_far": 1,
        "wrong_format": 1,
        "wrong_length": 1,
    }
    assert list(tested.rejected) == sorted(tested.rejected)


def test_each_message_has_a_counter_of_its_own() -> None:
    tested = reception()
    for counter in range(3):
        assert tested.take(encode(COMMAND, counter)) == COMMAND
        assert tested.take(encode(LateralError(0.5, 0.0), 100 + counter)) is not None
    assert (tested.accepted, tested.rejected) == (6, {})


def test_lost_frames_are_summed_over_the_messages() -> None:
    tested = reception()
    for counter in (0, 3):
        tested.take(encode(COMMAND, counter))
        tested.take(encode(LateralError(0.0, 0.0), 2 * counter))
    assert tested.lost == 2 + 5


def test_a_bad_frame_does_not_move_the_counter_on() -> None:
    tested = reception()
    tested.take(encode(COMMAND, 0))
    bad = encode(COMMAND, 9)
    tested.take(bad._replace(data=bad.data[:-1] + b"\xee"))
    assert tested.take(encode(COMMAND, 1)) == COMMAND
    assert tested.lost == 0


def test_a_message_sent_by_hand_has_no_counter_to_check() -> None:
    tested = reception()
    for _ in range(5):
        assert tested.take(encode(CONFIG, 0)) == CONFIG
    assert tested.accepted == 5


def test_a_sender_that_restarted_is_believed_after_the_run_that_was_set() -> None:
    tested = reception(resync_run=3)
    for counter in range(50, 60):
        tested.take(encode(COMMAND, counter))
    taken = [tested.take(encode(COMMAND, counter)) for counter in range(5)]
    assert [message == COMMAND for message in taken] == [False, False, False, True, True]
    assert tested.lost == 0
    assert tested.resynchronised == 1


def test_a_payload_of_another_message_is_distinguished_from_a_corrupted_one() -> None:
    tested = reception()
    tested.take(encode(COMMAND, 0))
    status = encode(SteeringStatus(0.1, 7, SteeringStatusCode.APPLYING), 1)
    assert tested.take(status._replace(can_id=CAN_IDS[SteeringCommand])) is Rejection.MASQUERADED
    assert tested.take(encode(COMMAND, 1)) == COMMAND
    assert tested.rejected == {"masqueraded": 1}


@given(st.sampled_from(sorted(CAN_IDS.values())), st.binary(max_size=64), st.integers(0, 31))
def test_every_frame_is_accepted_refused_or_ignored(can_id: int, data: bytes, flags: int) -> None:
    tested = reception()
    taken = tested.take(Frame(can_id, data, flags))
    counted = tested.accepted + sum(tested.rejected.values())
    assert counted == (0 if taken is None else 1)
