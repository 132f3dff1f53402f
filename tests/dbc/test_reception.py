"""Reception: what it accepts, why it refuses the rest, and whose second sender it reports."""

import pytest

from steer_by_wire.dbc.codec.counter_rule import CounterRule
from steer_by_wire.dbc.codec.sender_watch import ECHO_TICKS
from steer_by_wire.dbc.messages import (
    Direction,
    LatencyConfig,
    LateralError,
    Message,
    SecondSender,
    SteeringCommand,
    SteeringPlan,
    VehicleState,
    encode,
)
from steer_by_wire.dbc.reception import NOTICE_NS, Reception
from steer_by_wire.plant_emulator.steering.plan_buffer import PLAN_VALUES
from steer_by_wire.runtime.frame import BITRATE_SWITCH, ERROR, EXTENDED, FD, REMOTE, Frame
from tests.support.frames.made_messages import command_of, error_of, latency_of, motion_of, plan_of

MS = 1_000_000
RULE = CounterRule(lead_ns=30 * MS, resync_run=3, resync_ns=100 * MS)
ERROR_OF = error_of(0.25)
TRUE = encode(ERROR_OF, 0)
CONFIG = latency_of(Direction.BOTH, 0.01)
PLAN = plan_of((0.1 for _ in range(PLAN_VALUES)), plan_number=7, first_sample=1)


def receiver() -> Reception:
    return Reception((LateralError, VehicleState, LatencyConfig), RULE, (SteeringCommand,))


def command(number: int, steer_rad: float = 0.1) -> Frame:
    return encode(command_of(steer_rad, number), number % 256)


@pytest.mark.parametrize(
    ("frame", "cause"),
    [
        (TRUE._replace(data=TRUE.data[:-1]), "wrong_length"),
        (TRUE._replace(flags=EXTENDED), "wrong_format"),
        (TRUE._replace(flags=REMOTE), "wrong_format"),
        (TRUE._replace(flags=ERROR), "wrong_format"),
        (TRUE._replace(flags=FD), "wrong_format"),
        (TRUE._replace(flags=FD | BITRATE_SWITCH, data=bytes(20)), "no_key"),
        (TRUE._replace(data=bytes([TRUE.data[0] ^ 1]) + TRUE.data[1:]), "bad_crc"),
        (encode(motion_of(1.4, 0.1, 0.02), 0)._replace(can_id=TRUE.can_id), "masqueraded"),
        (command(0), "own_identifier"),
        (TRUE, "repeated"),
        (encode(ERROR_OF, 255), "out_of_order"),
        (encode(ERROR_OF, 5), "too_far"),
    ],
)
def test_a_refused_frame_is_counted_by_its_cause(frame: Frame, cause: str) -> None:
    tested = receiver()
    assert tested.receive(TRUE, 0) == ERROR_OF
    tested.receive(frame, 5 * MS)
    assert tested.rejected == {cause: 1}
    assert (tested.accepted, tested.refused) == (1, 1)
    assert tested.receive(encode(ERROR_OF, 1), 10 * MS) == ERROR_OF


def test_other_identifiers_and_messages_without_counters() -> None:
    tested = receiver()
    assert tested.receive(TRUE._replace(can_id=0x7FF)) is None
    for _ in range(2):
        assert tested.receive(encode(CONFIG, 0)) == CONFIG
    assert (tested.accepted, tested.refused) == (2, 0)


def test_plans_and_commands_are_one_sequence() -> None:
    kinds: tuple[type[Message], ...] = (SteeringCommand, SteeringPlan)
    tested = Reception(kinds, RULE)
    for number in range(6):
        frame = command(number) if number % 2 else encode(PLAN, number)
        assert type(tested.receive(frame, 10 * number * MS)) is kinds[1 - number % 2]
    tested.receive(encode(PLAN, 5), 55 * MS)
    assert tested.rejected == {"repeated": 1}


def test_an_echo_of_an_own_frame_is_no_second_sender() -> None:
    tested = receiver()
    for number in range(ECHO_TICKS + 1):
        tested.on_sent([command(number)])
    tested.receive(command(1), 0)
    tested.receive(command(ECHO_TICKS), 0)
    assert (tested.refused, tested.second_sender(0)) == (0, SecondSender.NONE)
    tested.receive(command(7)._replace(flags=ERROR), 0)
    assert tested.second_sender(0) is SecondSender.NONE
    for other in (command(0), command(7, 0.2)):  # sent too long ago, and another content
        tested.receive(other, 5 * MS)
    assert tested.rejected == {"own_identifier": 2, "wrong_format": 1}
    assert tested.second_senders == ["STEERING_COMMAND"]


def test_a_second_sender_is_reported_for_a_second() -> None:
    tested, noticed_ns = receiver(), 0
    for number in range(100):
        for now_ns, counter, value in ((10, number, 0.1), (14, number + 20, 0.2)):
            now_ns = 10 * number * MS + now_ns * MS
            tested.receive(encode(error_of(value), counter % 256), now_ns)
            noticed_ns = now_ns
    assert tested.second_senders == ["LATERAL_ERROR"]
    assert tested.second_sender(noticed_ns + NOTICE_NS - 20 * MS) is SecondSender.PEER
    tested.receive(command(0), noticed_ns)
    assert tested.second_sender(noticed_ns) is SecondSender.BOTH
    assert tested.second_sender(noticed_ns + NOTICE_NS) is SecondSender.NONE
