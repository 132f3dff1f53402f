"""A second sender of a message: what it can take over, for how long, and who says so."""

from collections.abc import Sequence
from copy import deepcopy
from functools import cache
from typing import NamedTuple

import pytest

from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc.codec.sequence_and_second_sender import SequenceRule
from steer_by_wire.dbc.messages import (
    ControllerSafety,
    Decoded,
    LateralError,
    Message,
    Mode,
    MotionRequest,
    PlantStatus,
    SecondSender,
    SteeringCommand,
    decode,
    encode,
)
from steer_by_wire.dbc.reception import PAUSE_NS, Reception, TakenBack
from steer_by_wire.plant_emulator.settings import PlantSettings, plant_preset
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node import NS_PER_MS, NS_PER_S
from tests.support.attacks.forged_counters import Shot
from tests.support.attacks.intruder import Attack, Run, drive
from tests.support.suite.combinations import combined, sampled

Shots = Sequence[Sequence[Shot]]
PERIOD_NS = 10 * NS_PER_MS
CONTROLLER = controller_preset("practical_pd_ddob")
PLANT = PlantSettings(duration_s=6.0)
COMMANDS, MEASUREMENTS = PLANT.counters, CONTROLLER.counters
WARM_UP, ATTACK = 100, 60
TRUE, FALSE = 0.1, 0.5
"""What the true and the false sender send."""


def message(*, is_measured: bool, value: float, number: int) -> Message:
    if is_measured:
        return LateralError(value, 1e-3 * (number % 1000))
    return SteeringCommand(value, number % 65_536, Mode.ACTIVE)


@cache
def stream(*, is_measured: bool, value: float) -> dict[int, Frame]:
    """The frames of the true or the false sender by their numbers."""
    return {
        number: encode(message(is_measured=is_measured, value=value, number=number), number % 256)
        for number in range(-WARM_UP, 4 * WARM_UP)
    }


class Foreign(NamedTuple):
    """What a receiver does beside a false stream.

    ``false_ns``        for how long a false frame is in use
    ``unused_true``     true frames that do not bring another frame into use
    ``accepted_after``  true frames that do, in 50 after the end
    """

    false_ns: int
    unused_true: int
    noticed: SecondSender
    accepted_after: int


def hear(warm: Reception, kind: type[Message], offset: int) -> Foreign:
    """A false stream at the true one's rate, ``offset`` counters ahead of it, 4 ms after it."""
    tested, true, false = (
        deepcopy(warm),
        stream(is_measured=kind is LateralError, value=TRUE),
        stream(is_measured=kind is LateralError, value=FALSE),
    )
    false_ns = unused_true = accepted_after = 0
    noticed = SecondSender.NONE
    in_use = TRUE
    for number in range(WARM_UP, WARM_UP + ATTACK + 50):
        now_ns, is_attacked = number * PERIOD_NS, number < WARM_UP + ATTACK
        taken = tested.take(true[number], now_ns)
        taken = taken.message if isinstance(taken, TakenBack) else taken
        is_used = isinstance(taken, LateralError | SteeringCommand)
        unused_true += is_attacked and not is_used
        accepted_after += not is_attacked and is_used
        in_use = taken[0] if isinstance(taken, LateralError | SteeringCommand) else in_use
        false_ns += 4 * NS_PER_MS * (in_use > 0.3)
        if is_attacked:
            taken = tested.take(false[number + offset], now_ns + 4 * NS_PER_MS)
            taken = taken.message if isinstance(taken, TakenBack) else taken
            noticed = tested.second_sender(now_ns)
        in_use = taken[0] if isinstance(taken, LateralError | SteeringCommand) else in_use
        false_ns += 6 * NS_PER_MS * (in_use > 0.3)
    return Foreign(false_ns, unused_true, noticed, accepted_after)


@pytest.mark.parametrize(
    ("kind", "rule", "ahead"), [(SteeringCommand, COMMANDS, 5), (LateralError, MEASUREMENTS, 31)]
)
def test_of_all_offsets_a_few_are_followed_for_a_short_time_and_then_nobody(
    kind: type[Message], rule: SequenceRule, ahead: int
) -> None:
    warm = Reception((kind,), rule)
    for number in range(WARM_UP):
        assert isinstance(
            warm.take(
                stream(is_measured=kind is LateralError, value=TRUE)[number], number * PERIOD_NS
            ),
            kind,
        )
    heard = {offset: hear(warm, kind, offset) for offset in range(-127, 129)}
    assert {offset for offset, one in heard.items() if one.false_ns} == set(range(1, ahead + 1))
    # Five true frames in a row that come late contradict what has overtaken more; the sixth does,
    # where it overtook five, since its own counter then comes again.
    assert max(one.false_ns for offset, one in heard.items() if offset != 6) <= 5 * PERIOD_NS
    assert heard[6].false_ns <= 6 * PERIOD_NS
    for offset, one in heard.items():
        assert one.noticed is SecondSender.PEER, offset
        assert one.accepted_after >= 30, offset
    # At once, but for those that are as late as a true frame can be: these take up to 40 frames.
    unnoticed = {o: ATTACK - one.unused_true for o, one in heard.items()}
    slow = [offset for offset, frames in unnoticed.items() if frames > 6]
    assert set(slow) <= {-ahead - 9, -ahead - 8}
    assert max(unnoticed.values()) <= 40


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
        frame = encode(message(is_measured=False, value=TRUE, number=number), number % 256)
        tested.take(frame, number * period_ms * NS_PER_MS)
    assert tested.rejected == {}


# The pair in virtual time

ONSET_NS = 2 * NS_PER_S
ATTACK_NS = 2 * NS_PER_S
SOON_NS = 100_000
OWN, PEER = SecondSender.OWN, SecondSender.PEER


@pytest.fixture(scope="module")
def alone() -> Run:
    return drive(PLANT, CONTROLLER)


@cache
def silence_m() -> float:
    """What the worse silence of a message costs, for as long as an attack lasts."""
    attacks = (Attack(kind, 0.0, ONSET_NS, ATTACK_NS) for kind in (LateralError, SteeringCommand))
    return max(drive(PLANT, CONTROLLER, attack).peak_m for attack in attacks)


def requests(run: Run) -> list[tuple[int, MotionRequest]]:
    """What the controller asked of the vehicle's drive, and when."""
    decoded = [(time_ns, decode(frame)) for time_ns, frame in run.frames]
    return [
        (time_ns, one.message.motion_request)
        for time_ns, one in decoded
        if isinstance(one, Decoded) and isinstance(one.message, ControllerSafety)
    ]


def notices(run: Run, kind: type[PlantStatus | ControllerSafety]) -> list[tuple[int, SecondSender]]:
    """When a node reported a second sender or none, and which."""
    decoded = [(time_ns, decode(frame)) for time_ns, frame in run.frames]
    return [
        (time_ns, one.message.second_sender)
        for time_ns, one in decoded
        if isinstance(one, Decoded) and isinstance(one.message, kind)
    ]


def check_notices(run: Run, sender: str, own: SecondSender, peer: SecondSender) -> None:
    """Both nodes name it while it lasts, and for a second afterwards."""
    end_ns = ONSET_NS + ATTACK_NS
    told = {"plant": notices(run, PlantStatus), "controller": notices(run, ControllerSafety)}
    for name, noticed in told.items():
        during = {one for at_ns, one in noticed if ONSET_NS + 4 * 10**8 < at_ns < end_ns}
        assert during == {own if name == sender else peer}
        assert {one for at_ns, one in noticed if at_ns < ONSET_NS} == {SecondSender.NONE}
        assert noticed[-1][1] is SecondSender.NONE
    assert run.plant["second_senders"] == run.controller["second_senders"]


def beside(kind: type[Message], ahead: int) -> Run:
    """A run beside a false stream, so far ahead and 4 ms after the true one."""
    shots = [[Shot(4 * NS_PER_MS, ahead)]]
    value = 0.2 if kind is LateralError else 0.6
    return drive(PLANT, CONTROLLER, Attack(kind, value, ONSET_NS, ATTACK_NS, shots))


@pytest.mark.parametrize("ahead", sampled([-3, 0, 5, 60], [-60, -3, 0, 1, 3, 5, 6, 18, 60, 100]))
def test_no_foreign_stream_of_commands_moves_the_vehicle_further_than_silence_does(
    ahead: int,
) -> None:
    run = beside(SteeringCommand, ahead)
    check_notices(run, "controller", OWN, PEER)
    assert run.plant["second_senders"] == ["STEERING_COMMAND"]
    assert run.plant["safety"]["holdings"] >= 1
    assert run.peak_m < silence_m() + 0.1
    # The true sender asks the vehicle to stop while it lasts, and no longer.
    assert MotionRequest.STOP not in {one for _, one in requests(run)[-20:]}
    stops_ns = [at_ns for at_ns, one in requests(run) if one is MotionRequest.STOP]
    assert ONSET_NS < stops_ns[0] < ONSET_NS + NS_PER_S


@pytest.mark.parametrize("ahead", sampled([-60, 1, 31, 32], [-60, -3, 0, 1, 15, 31, 32, 100]))
def test_no_foreign_stream_of_measurements_moves_the_vehicle_further_than_silence_does(
    ahead: int,
) -> None:
    run = beside(LateralError, ahead)
    check_notices(run, "plant", OWN, PEER)
    assert run.controller["second_senders"] == ["LATERAL_ERROR"]
    assert run.plant["safety"]["holdings"] >= 1
    assert run.peak_m < silence_m() + 0.1


BURST = [Shot(SOON_NS, 1 + step) for step in range(16)]
STRATEGIES: dict[str, tuple[Shots, bool]] = {
    "one": ([[Shot(SOON_NS, 1)]], False),
    "one far ahead": ([[Shot(SOON_NS, 31)]], False),
    "a burst": ([BURST], False),
    "a burst, and then one a period": ([BURST, *[[Shot(SOON_NS, 16)]] * 400], False),
    "behind every second true frame": ([[Shot(SOON_NS, 1)], []], True),
    "behind every third": ([[Shot(SOON_NS, 1)], [], []], True),
    "behind every fifth": ([[Shot(SOON_NS, 1)], [], [], [], []], True),
    "behind four of five": ([[Shot(SOON_NS, 1)]] * 4 + [[]], True),
    "as far ahead as is believed": ([[Shot(SOON_NS, 30)]], True),
    "just before the true one": ([[Shot(9_900_000, 1)]], True),
}


@pytest.mark.parametrize(
    ("name", "sign", "kind"),
    combined([*STRATEGIES], [1.0, -1.0], [SteeringCommand, LateralError, LateralError]),
)
def test_no_choice_of_counters_costs_more_than_silence_of_the_same_length(
    kind: type[Message], name: str, sign: float
) -> None:
    shots, repeats = STRATEGIES[name]
    value = sign * (0.2 if kind is LateralError else 0.6)
    attack = Attack(kind, value, ONSET_NS, ATTACK_NS, shots, repeats)
    run = drive(PLANT, CONTROLLER, attack)
    assert run.peak_m < silence_m() + 0.1
    assert run.plant["safety"]["safe_state"] is None


@pytest.mark.parametrize(
    ("ahead", "kind"), combined([-60, 1, 0, 31, 5, -3, 100, 3], [SteeringCommand, LateralError])
)
def test_one_forged_frame_stops_nobody(alone: Run, kind: type[Message], ahead: int) -> None:
    value = 80.0 if kind is LateralError else 0.6
    shots = [[Shot(SOON_NS, ahead)]]
    run = drive(PLANT, CONTROLLER, Attack(kind, value, ONSET_NS, ATTACK_NS, shots, repeats=False))
    assert run.controller["holds"] == run.plant["safety"]["holdings"] == 0
    assert run.peak_m < alone.peak_m + 0.05
    told = notices(run, PlantStatus if kind is LateralError else ControllerSafety)
    own_ns = [at_ns for at_ns, one in told if one is OWN]
    assert len(own_ns) >= 9
    assert own_ns[-1] - ONSET_NS <= 1.1 * NS_PER_S


@pytest.mark.parametrize(
    ("forged", "onset_ns"),
    combined(
        [("predictor", -1.0), ("predictor", 10.0), ("pd_ddob", 10.0), ("pd", 80.0)],
        [NS_PER_S, NS_PER_S // 5],
    ),
)
def test_a_law_forgets_a_forged_measurement_at_speed(
    forged: tuple[str, float], onset_ns: int
) -> None:
    """At 60 km/h: 1.1, 3.8, 1.5 and 1.1 m off where it stays in the history or the filters.

    And up to 5.2 m after a start, when none is too old to be forged.
    """
    law, value_m = forged
    plant = plant_preset("highway_corner_d", ['path={kind="straight"}', "duration_s=4"])
    attack = Attack(LateralError, value_m, onset_ns, PERIOD_NS, [[Shot(SOON_NS, 31)]], False)
    run = drive(plant, controller_preset(f"highway_{law}"), attack)
    assert run.controller["second_senders"] == ["LATERAL_ERROR"]
    assert run.peak_m < 0.08


def test_the_limits_of_the_steering_forget_a_forged_command_at_speed() -> None:
    """In a lane change: 0.39 m more where its jerk keeps the wheel from coming back."""
    plant = plant_preset("highway_corner_d", ["duration_s=15"])
    law = controller_preset("highway_pd")
    attack = Attack(SteeringCommand, -0.6, 12_750_000_000, PERIOD_NS, [[Shot(SOON_NS, 5)]], False)
    forged = drive(plant, law, attack)
    assert forged.plant["rejected"]["taken_back"] == 1
    assert forged.peak_m < drive(plant, law).peak_m + 0.02


def test_forged_commands_at_speed_cost_little_more_than_the_silence_that_they_cause() -> None:
    """In a lane change, the dearest law and strategy of ``tests.soak.forged_strategies``."""
    plant, law = (
        plant_preset("highway_corner_d", ["duration_s=17"]),
        controller_preset("highway_pd"),
    )
    attack = Attack(
        SteeringCommand,
        -0.6,
        12_750_000_000,
        ATTACK_NS,
        *STRATEGIES["a burst, and then one a period"],
    )
    silence = Attack(LateralError, 0.0, attack.onset_ns, ATTACK_NS + PAUSE_NS)
    assert drive(plant, law, attack).peak_m < drive(plant, law, silence).peak_m + 0.3


@pytest.mark.parametrize("ahead", sampled([60], [1, 60]))
def test_forged_commands_and_plans_beside_plans_are_of_one_sequence(ahead: int) -> None:
    """0.9 and 8.9 m where each message has its own: only the intruder then sends commands."""
    plant, law = PlantSettings(duration_s=10.0), controller_preset("practical_packet")
    silence = Attack(SteeringCommand, -0.5, 6 * NS_PER_S, 2 * NS_PER_S)
    run = drive(plant, law, silence._replace(shots=[[Shot(SOON_NS, ahead)]]))
    assert run.plant["second_senders"] == ["STEERING_COMMAND"]
    assert run.controller["second_senders"] == ["STEERING_COMMAND", "STEERING_PLAN"]
    assert run.peak_m < drive(plant, law, silence).peak_m + 0.02
