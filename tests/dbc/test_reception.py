"""Which of the frames it receives a node accepts: random streams against rules written apart."""

from collections import Counter
from itertools import permutations
from random import Random
from types import ModuleType
from typing import Any

from steer_by_wire.dbc import reception
from steer_by_wire.dbc.codec.sequence_and_second_sender import (
    CHANGING,
    SequenceCheck,
    SequenceResult,
    SequenceRule,
)
from steer_by_wire.dbc.messages import (
    CAN_IDS,
    Decoded,
    Direction,
    LatencyConfig,
    LatencyModel,
    LateralError,
    Message,
    Mode,
    PathAhead,
    Rejection,
    SecondSender,
    SteeringCommand,
    SteeringPlan,
    VehicleState,
    decode,
    encode,
    rejection_of,
)
from steer_by_wire.dbc.reception import TakenBack
from steer_by_wire.dbc.secoc.secured_frame import Refused
from steer_by_wire.plant_emulator.steering.plan_buffer import PLAN_VALUES
from steer_by_wire.runtime.frame import BITRATE_SWITCH, EXTENDED, FD, REMOTE, Frame

MS = 1_000_000
RULE = SequenceRule(lead_ns=30 * MS, resync_run=3, resync_ns=100 * MS)
PERIODS_MS: dict[type[Message], int] = {LateralError: 10, VehicleState: 20, PathAhead: 20}
SECURED_LENGTHS = {LateralError: 20, VehicleState: 20, PathAhead: 64}
PAUSE_NS, NOTICE_NS = 50 * MS, 1000 * MS
STEPS_NS = (0, 1, MS, 5 * MS, 10 * MS, 10 * MS, PAUSE_NS - 1, PAUSE_NS, PAUSE_NS + 1)
SENT = (SteeringCommand,)
DRIVES, FRAMES = 30, 60


class Told:
    """The rules as the documents tell them."""

    def __init__(self) -> None:
        self.checks = {
            kind: SequenceCheck(RULE, period_ms * MS) for kind, period_ms in PERIODS_MS.items()
        }
        self.rejected = Counter[str]()
        self.accepted = 0
        self.sends = True
        self.own_ns: int | None = None
        self.paused_until_ns = 0

    def refuse(self, cause: Any) -> Any:
        self.rejected[cause.value] += 1
        return cause

    def take(self, frame: Frame, now_ns: int) -> Any:
        kind = next((one for one, can_id in CAN_IDS.items() if can_id == frame.can_id), None)
        decoded = decode(frame)
        if kind in SENT:
            self.own_ns = now_ns
            if self.sends and isinstance(decoded, Decoded):
                self.paused_until_ns = now_ns + PAUSE_NS
            return self.refuse(Rejection.OWN_IDENTIFIER)
        if kind is not LatencyConfig and kind not in PERIODS_MS:
            return None
        if now_ns < self.paused_until_ns:
            return self.refuse(Rejection.PAUSED)
        if not isinstance(decoded, Decoded):
            is_secured = frame.flags & FD and len(frame.data) == SECURED_LENGTHS.get(kind)
            return self.refuse(Refused.NO_KEY if is_secured else rejection_of(frame))
        if kind is LatencyConfig:
            self.accepted += 1
            return decoded.message
        check = self.checks[kind]
        result = check.check(decoded.counter, now_ns, frame.data)
        if result in (SequenceResult.ACCEPTED, SequenceResult.CONFIRMED):
            self.accepted += 1
        elif result is not SequenceResult.WAITING:
            self.refuse(result)
        if result not in CHANGING:
            return result
        assert isinstance(check.content, bytes)
        used = decode(frame._replace(data=check.content))
        assert isinstance(used, Decoded)
        return TakenBack(used.message) if result is SequenceResult.TAKEN_BACK else used.message

    def second_sender(self, now_ns: int) -> SecondSender:
        noticed = [check.second_sender_ns for check in self.checks.values()]
        number = 1 if self.own_ns is not None and now_ns - self.own_ns < NOTICE_NS else 0
        number += 2 * any(one is not None and now_ns - one < NOTICE_NS for one in noticed)
        return SecondSender(number)

    def second_senders(self) -> list[str]:
        names = ["LATERAL_ERROR", "VEHICLE_STATE", "PATH_AHEAD", "STEERING_COMMAND"]
        kinds = [LateralError, VehicleState, PathAhead]
        seen = [self.checks[kind].second_sender_ns is not None for kind in kinds]
        return sorted(
            n for n, is_seen in zip(names, [*seen, self.own_ns is not None], strict=True) if is_seen
        )


class Stream:
    """Frames of one message: in sequence for the most part, of a second sender in between."""

    def __init__(self, kind: type[Message], random: Random) -> None:
        self._kind, self._random = kind, random
        self._counter = random.randrange(256)

    def next(self) -> Frame:
        random = self._random
        self._counter += random.choice((1, 1, 1, 1, 2, 0, -1, 40))
        counter = (self._counter + random.choice((0, 0, 0, 0, 0, 100))) % 256
        return encode(message_of(self._kind, random.choice((0.25, 0.25, 0.25, 0.5))), counter)


def message_of(kind: type[Message], value: float) -> Message:
    if kind is LatencyConfig:
        return LatencyConfig(Direction.BOTH, LatencyModel.CONSTANT, 0.01, 0.0, 0.0)
    if kind is PathAhead:
        return PathAhead(1, 1.0, *(0.01 * value for _ in PathAhead._fields[2:]))
    if kind is LateralError:
        return LateralError(value, 0.0)
    if kind is VehicleState:
        return VehicleState(1.4, value, 0.02)
    if kind is SteeringPlan:
        return SteeringPlan(7, Mode.ACTIVE, 1, 1, *(value for _ in range(PLAN_VALUES)))
    return SteeringCommand(value, 7, Mode.ACTIVE)


def spoiled(frame: Frame, random: Random) -> Frame:
    """Return a frame that is no message of ours, or a secured one."""
    place = random.randrange(max(len(frame.data), 1))
    bit = 1 << random.randrange(8)
    return random.choice(
        (
            frame._replace(data=frame.data[:-1]),
            frame._replace(data=frame.data + b"\0"),
            frame._replace(flags=frame.flags ^ random.choice((EXTENDED, REMOTE, FD))),
            frame._replace(flags=FD | BITRATE_SWITCH, data=bytes(random.choice((20, 48, 64)))),
            frame._replace(
                data=bytes(one ^ bit * (n == place) for n, one in enumerate(frame.data))
            ),
        )
    )


def drive(tested: ModuleType, random: Random) -> None:
    """Feed both the same frames, and compare them after each."""
    kinds = (*PERIODS_MS, LatencyConfig)
    tested_one = tested.Reception(kinds, RULE, SENT)
    told, now_ns = Told(), random.choice((0, 10**12))
    assert tested_one.second_sender(now_ns) is SecondSender.NONE
    streams = [Stream(kind, random) for kind in (*kinds, *kinds[:1] * 4, *SENT)]
    alien = encode(message_of(SteeringCommand, 0.0), 0)._replace(can_id=0x7FF)
    for _ in range(FRAMES):
        now_ns += random.choice(STEPS_NS)
        frame = random.choice(streams).next() if random.random() < 0.97 else alien
        if random.random() < 0.15:
            frame = spoiled(frame, random)
        if random.random() < 0.1:
            tested_one.sends = told.sends = not told.sends
        assert tested_one.take(frame, now_ns) == told.take(frame, now_ns)
        assert list(tested_one.rejected.items()) == sorted(told.rejected.items())
        assert (tested_one.accepted, tested_one.refused) == (told.accepted, told.rejected.total())
        for kind, check in told.checks.items():
            assert tested_one.newest(kind).counter == check.counter
        assert tested_one.lost == sum(check.lost for check in told.checks.values())
        restarts = sum(check.resynchronised for check in told.checks.values())
        assert tested_one.resynchronised == restarts
        assert sorted(tested_one.second_senders) == told.second_senders()
        noticed_ns = random.choice(
            [told.own_ns, *(c.second_sender_ns for c in told.checks.values())]
        )
        for at_ns in (now_ns, *(() if noticed_ns is None else edges(noticed_ns))):
            assert tested_one.second_sender(at_ns) is told.second_sender(at_ns)


def check_that_plans_and_commands_are_one_sequence(tested: ModuleType) -> None:
    """Each contradicts the other under one counter, and what was in use before comes back."""
    frames = {
        kind: [encode(message_of(kind, 0.25), number) for number in range(20)]
        for kind in (SteeringCommand, SteeringPlan)
    }
    for kinds in permutations(frames):
        for one, other in permutations(frames):
            receiver = tested.Reception(kinds, RULE)
            for number, frame in enumerate(frames[one]):
                assert type(receiver.take(frame, number * 10 * MS)) is one
            back = receiver.take(frames[other][-1], 195 * MS)
            assert isinstance(back, tested.TakenBack)
            assert type(back.message) is one
            assert receiver.rejected == {"taken_back": 1}
            assert receiver.lost == 0


def edges(noticed_ns: int) -> tuple[int, ...]:
    return tuple(noticed_ns + NOTICE_NS + step for step in (-1, 0, 1))


def check(tested: ModuleType) -> None:
    assert {kind: tested.cycle_ns(kind) for kind in PERIODS_MS} == {
        kind: period_ms * MS for kind, period_ms in PERIODS_MS.items()
    }
    untimed = tested.Reception(PERIODS_MS, RULE)
    untimed.take(encode(message_of(LateralError, 0.0), 0))
    assert untimed.newest(LateralError).arrival_ns == 0
    check_that_plans_and_commands_are_one_sequence(tested)
    for number in range(DRIVES):
        drive(tested, Random(number))


def test_random_streams_are_received_as_the_rules_say() -> None:
    check(reception)
