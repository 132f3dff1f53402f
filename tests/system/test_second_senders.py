"""A second sender of a message: what it can take over, for how long, and who says so."""

from collections.abc import Iterable, Mapping
from copy import deepcopy
from functools import cache
from typing import Any, NamedTuple

import pytest

from steer_by_wire.closed_loop.virtual_pair import make_virtual_pair
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc.codec.protection import SequenceRule
from steer_by_wire.dbc.messages import (
    CAN_IDS,
    ControllerSafety,
    Decoded,
    LateralError,
    Message,
    Mode,
    PlantStatus,
    SecondSender,
    SteeringCommand,
    decode,
    encode,
)
from steer_by_wire.dbc.reception import Reception
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node import NS_PER_MS, NS_PER_S
from steer_by_wire.runtime.node.virtual_time import VirtualTimeExecutor
from tests.support.timed_sender import TimedSender

PERIOD_NS = 10 * NS_PER_MS
CONTROLLER = controller_preset("practical_pd_ddob")
PLANT = PlantSettings(duration_s=6.0)
COMMANDS, MEASUREMENTS = PLANT.counters, CONTROLLER.counters
WARM_UP, ATTACK = 100, 60
TRUE, FALSE = 0.1, 0.5
"""What the true and the false sender send."""


def message(kind: type[Message], value: float, number: int) -> Message:
    if kind is LateralError:
        return LateralError(value, 1e-3 * (number % 1000))
    return SteeringCommand(value, number % 65_536, Mode.ACTIVE)


@cache
def streams() -> Mapping[tuple[type[Message], float], Mapping[int, Frame]]:
    """The frames of the true and the false sender by their numbers, of both messages."""
    return {
        (kind, value): {
            number: encode(message(kind, value, number), number % 256)
            for number in range(-WARM_UP, 4 * WARM_UP)
        }
        for kind in (LateralError, SteeringCommand)
        for value in (TRUE, FALSE)
    }


class Attack(NamedTuple):
    """False frames that a receiver followed, whether at once, and how the attack ended."""

    followed: int
    at_once: bool
    noticed: SecondSender
    refused_true: int
    accepted_after: int


def attack(warm: Reception, kind: type[Message], offset: int) -> Attack:
    """A false stream at the true one's rate, ``offset`` counters ahead of it, 4 ms after it."""
    tested, true, false = deepcopy(warm), streams()[kind, TRUE], streams()[kind, FALSE]
    followed = refused_true = accepted_after = 0
    at_once = False
    for number in range(WARM_UP, WARM_UP + ATTACK + 50):
        now_ns = number * PERIOD_NS
        is_attacked = number < WARM_UP + ATTACK
        taken = tested.take(true[number], now_ns)
        refused_true += is_attacked and not isinstance(taken, kind)
        accepted_after += number >= WARM_UP + ATTACK + 20 and isinstance(taken, kind)
        if not is_attacked:
            continue
        taken = tested.take(false[number + offset], now_ns + 4 * NS_PER_MS)
        followed += isinstance(taken, kind)
        at_once |= number == WARM_UP and isinstance(taken, kind)
        if number == WARM_UP + ATTACK - 1:
            noticed = tested.second_sender(now_ns)
    return Attack(followed, at_once, noticed, refused_true, accepted_after)


@pytest.mark.parametrize(
    ("kind", "rule", "ahead"), [(SteeringCommand, COMMANDS, 5), (LateralError, MEASUREMENTS, 31)]
)
def test_of_all_offsets_a_few_are_followed_and_each_for_a_short_time(
    kind: type[Message], rule: SequenceRule, ahead: int
) -> None:
    warm = Reception((kind,), rule)
    for number in range(WARM_UP):
        assert isinstance(warm.take(streams()[kind, TRUE][number], number * PERIOD_NS), kind)
    attacks = {offset: attack(warm, kind, offset) for offset in range(-127, 129)}
    assert {offset for offset, one in attacks.items() if one.at_once} == set(range(1, ahead + 1))
    for offset, one in attacks.items():
        assert one.followed == (offset + 4 if one.at_once else 0)
    # Here nobody can know which of the two is the true one: neither is followed any more.
    disputed = {offset for offset, one in attacks.items() if one.refused_true}
    assert disputed == set(range(ahead + 1))
    for one in attacks.values():
        assert one.noticed is SecondSender.PEER
        assert one.accepted_after == 30


def test_a_network_that_doubles_or_delays_frames_is_no_second_sender() -> None:
    tested = Reception((SteeringCommand,), COMMANDS)
    frames = [encode(message(SteeringCommand, 0.1, n), n % 256) for n in range(600)]
    for number, frame in enumerate(frames):
        for late in (0, 1, 7, 40):
            if number >= late and (late == 0 or number % 3 == 0):
                tested.take(frames[number - late] if late else frame, number * PERIOD_NS)
    assert tested.second_sender(600 * PERIOD_NS) is SecondSender.NONE
    assert tested.second_senders == []
    assert tested.accepted == 600


def test_a_sender_that_restarts_is_no_second_sender() -> None:
    true = streams()[SteeringCommand, TRUE]
    for restart in range(256):
        tested = Reception((SteeringCommand,), COMMANDS)
        now_ns = 0
        for number in [*range(300), *range(restart, restart + 100)]:
            now_ns += PERIOD_NS
            tested.take(true[number], now_ns)
        assert tested.second_senders == [], restart


def test_a_burst_of_losses_a_stall_and_a_bunch_lose_nothing_more() -> None:
    tested = Reception((LateralError,), MEASUREMENTS)
    sent = [*range(100), *range(170, 300)]  # 0.7 s of losses, believed at once
    for number in sent:
        tested.take(encode(LateralError(0.1, 0.0), number % 256), number * PERIOD_NS)
    for number in range(300, 360):  # what waited for 0.6 s comes at one instant
        tested.take(encode(LateralError(0.1, 0.0), number % 256), 360 * PERIOD_NS)
    assert (tested.accepted, tested.rejected) == (len(sent) + 60, {})
    assert tested.lost == 70


@pytest.mark.parametrize("period_ms", [1, 2, 50])
def test_at_other_rates_than_that_of_the_dbc_losses_are_believed_too(period_ms: int) -> None:
    tested = Reception((SteeringCommand,), COMMANDS)
    sent = [number for number in range(2000) if number < 600 or number % 100 < 60]
    for number in sent:
        frame = encode(message(SteeringCommand, 0.1, number), number % 256)
        tested.take(frame, number * period_ms * NS_PER_MS)
    assert tested.rejected == {}


# The pair in virtual time


ONSET_NS = 2 * NS_PER_S + 4 * NS_PER_MS
ATTACK_NS = 2 * NS_PER_S
FRAMES = ATTACK_NS // PERIOD_NS


def intruder(frames: Iterable[Frame]) -> TimedSender:
    """Send frames every period from the onset on."""
    return TimedSender((ONSET_NS + PERIOD_NS * sent, one) for sent, one in enumerate(frames))


class Run(NamedTuple):
    frames: list[tuple[int, Frame]]
    plant: Mapping[str, Any]
    controller: Mapping[str, Any]

    @property
    def peak_m(self) -> float:
        return float(self.plant["lateral_error_peak_m"])

    def notices(self, kind: type[PlantStatus | ControllerSafety]) -> list[tuple[int, SecondSender]]:
        """When a node reported a second sender or none, and which."""
        decoded = [(at_ns, decode(frame)) for at_ns, frame in self.frames]
        return [
            (at_ns, one.message.second_sender)
            for at_ns, one in decoded
            if isinstance(one, Decoded) and isinstance(one.message, kind)
        ]


def drive(attacker: TimedSender | None = None) -> Run:
    pair = make_virtual_pair(PLANT, CONTROLLER)
    frames: list[tuple[int, Frame]] = []
    others = [] if attacker is None else [attacker]
    executor = VirtualTimeExecutor(
        [pair.plant, pair.controller, *others],
        None,
        lambda ns, _, frame: frames.append((ns, frame)),
    )
    executor.run(20 * NS_PER_S)
    return Run(frames, pair.plant.report(), pair.controller.report())


@pytest.fixture(scope="module")
def alone() -> Run:
    return drive()


def replayed(run: Run, can_id: int, ahead: int) -> list[Frame]:
    """What a run sent from 0.5 s on, with counters that begin so far ahead of the true one."""
    sent = [decode(frame) for _, frame in run.frames if frame.can_id == can_id]
    first = ONSET_NS // PERIOD_NS + ahead
    return [
        encode(one.message, (first + step) % 256)
        for step, one in enumerate(sent[50 : 50 + FRAMES])
        if isinstance(one, Decoded)
    ]


def full_steer(ahead: int) -> list[Frame]:
    first = ONSET_NS // PERIOD_NS + ahead
    numbers = range(first, first + FRAMES)
    return [encode(SteeringCommand(0.6, n, Mode.ACTIVE), n % 256) for n in numbers]


def check_notices(run: Run, sender: str, own: SecondSender, peer: SecondSender) -> None:
    """Both nodes name it while it lasts, and for a second afterwards."""
    end_ns = ONSET_NS + ATTACK_NS
    told = {"plant": run.notices(PlantStatus), "controller": run.notices(ControllerSafety)}
    for name, notices in told.items():
        during = {one for at_ns, one in notices if ONSET_NS + 4 * 10**8 < at_ns < end_ns}
        assert during == {own if name == sender else peer}
        assert {one for at_ns, one in notices if at_ns < ONSET_NS} == {SecondSender.NONE}
        assert notices[-1][1] is SecondSender.NONE
    assert run.plant["second_senders"] == run.controller["second_senders"]


OWN, PEER = SecondSender.OWN, SecondSender.PEER


@pytest.mark.parametrize("ahead", [-60, -3, 0, 1, 3, 5, 6, 18, 60, 100])
@pytest.mark.parametrize("is_recorded", [True, False])
def test_no_foreign_stream_of_commands_moves_the_vehicle_further_than_a_hold_does(
    alone: Run, ahead: int, is_recorded: bool
) -> None:
    command_id = CAN_IDS[SteeringCommand]
    frames = replayed(alone, command_id, ahead) if is_recorded else full_steer(ahead)
    run = drive(intruder(frames))
    check_notices(run, "controller", OWN, PEER)
    assert run.plant["second_senders"] == ["STEERING_COMMAND"]
    safety = run.plant["safety"]
    if 0 <= ahead <= 5:
        assert run.plant["rejected"]["disputed"] > FRAMES
        assert (safety["holdings"], safety["recoveries"]) == (1, 1)
        assert run.peak_m < 0.4  # in two seconds without a command
    else:
        assert run.peak_m == alone.peak_m


@pytest.mark.parametrize("ahead", [-60, -3, 0, 1, 15, 31, 32, 100])
def test_a_replayed_stream_of_measurements_is_followed_or_refused_like_one_of_commands(
    alone: Run, ahead: int
) -> None:
    frames = replayed(alone, CAN_IDS[LateralError], ahead)
    run = drive(intruder(frames))
    check_notices(run, "plant", OWN, PEER)
    assert run.controller["second_senders"] == ["LATERAL_ERROR"]
    if 0 <= ahead <= 31:
        assert run.controller["rejected"]["disputed"] > FRAMES
        assert run.controller["holds"] == 1
        assert run.peak_m < 0.5  # in two seconds without a measurement
    else:
        assert run.peak_m == alone.peak_m


@pytest.mark.parametrize(("ahead", "peak_m"), [(1, 0.5), (15, 0.9), (31, 1.1)])
def test_what_the_controller_holds_in_a_dispute_is_not_from_the_false_measurements(
    ahead: int, peak_m: float
) -> None:
    first = ONSET_NS // PERIOD_NS + ahead
    false = LateralError(0.2, 0.0)
    frames = [encode(false, (first + step) % 256) for step in range(FRAMES)]
    run = drive(intruder(frames))
    assert run.controller["rejected"]["disputed"] > FRAMES
    assert run.peak_m < peak_m  # the command for the newest false one, held, costs 1.4 to 1.9 m


def test_one_frame_under_an_own_identifier_is_reported_for_a_second(alone: Run) -> None:
    run = drive(intruder([Frame(CAN_IDS[LateralError], bytes(8))]))
    told = [one for _, one in run.notices(PlantStatus)]
    assert told.count(OWN) == 10
    assert run.plant["rejected"] == {"own_identifier": 1}
    assert run.peak_m == alone.peak_m
