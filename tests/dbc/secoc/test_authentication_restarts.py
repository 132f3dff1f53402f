"""Authenticated ends that start late, restart or receive a recording: which frames they accept."""

from collections.abc import Sequence

import pytest

from steer_by_wire.dbc.secoc.authentication import Authentication
from steer_by_wire.dbc.secoc.challenges import KEPT
from steer_by_wire.dbc.secoc.secured_frame import Refused, plain
from steer_by_wire.runtime.frame import Frame
from tests.support.authenticated_ends import (
    COMMAND,
    CONTROLLER_STATUS,
    FROM_PLANT,
    PLANT_STATUS,
    controller,
    met,
    plant,
)


def exchange(controller_end: Authentication, plant_end: Authentication) -> list[object]:
    """One status and one measurement from the plant, one status back; the controller's verdicts."""
    status = controller_end.verify(plant_end.secure(PLANT_STATUS))
    plant_end.verify(controller_end.secure(CONTROLLER_STATUS))
    return [status, controller_end.verify(plant_end.secure(FROM_PLANT[0]))]


def test_a_receiver_that_starts_late_believes_the_second_status_at_the_latest() -> None:
    _, plant_end = met()
    for _ in range(1000):
        plant_end.secure(FROM_PLANT[0])
    late = controller(challenge=b"ctrl-two", first_counter=10**6)
    assert late.verify(plant_end.secure(FROM_PLANT[0])) is Refused.UNSYNCHRONISED
    assert exchange(late, plant_end) == [Refused.UNSYNCHRONISED, FROM_PLANT[0]]
    assert exchange(late, plant_end) == [PLANT_STATUS, FROM_PLANT[0]]
    assert plant_end.verify(late.secure(COMMAND)) == COMMAND


def test_a_sender_that_restarted_is_believed_when_it_has_received_a_status() -> None:
    controller_end, plant_end = met()
    for _ in range(50):
        assert controller_end.verify(plant_end.secure(FROM_PLANT[0])) == FROM_PLANT[0]
    restarted = plant(challenge=b"planttwo", first_counter=10**6)
    assert controller_end.verify(restarted.secure(FROM_PLANT[0])) is Refused.UNSYNCHRONISED
    assert exchange(controller_end, restarted) == [Refused.UNSYNCHRONISED, FROM_PLANT[0]]
    assert exchange(controller_end, restarted) == [PLANT_STATUS, FROM_PLANT[0]]
    assert restarted.verify(controller_end.secure(COMMAND)) == COMMAND


def test_before_it_has_received_a_challenge_an_end_sends_what_nobody_accepts() -> None:
    sender = plant()
    secured = sender.secure(FROM_PLANT[0])
    assert secured.data[12:] == bytes(8)
    assert plain(secured) == FROM_PLANT[0]  # who only watches sees it all the same
    assert met()[0].verify(secured) is Refused.UNSYNCHRONISED


def recorded_session(plant_end: Authentication, controller_end: Authentication) -> list[Frame]:
    """All frames that a listener receives of two ends that meet and run."""
    frames = []
    for _ in range(20):
        for frame in (*FROM_PLANT, PLANT_STATUS):
            frames.append(plant_end.secure(frame))
            controller_end.verify(frames[-1])
        for frame in (COMMAND, CONTROLLER_STATUS):
            frames.append(controller_end.secure(frame))
            plant_end.verify(frames[-1])
    assert controller_end.is_synchronised
    assert plant_end.is_synchronised
    return frames


def accepted(end: Authentication, frames: Sequence[Frame]) -> list[Frame]:
    return [frame for frame in frames if not isinstance(end.verify(frame), Refused)]


def test_an_old_session_opens_nothing_to_an_end_that_starts() -> None:
    """Neither before it has met its peer nor after, forwards, backwards, and again."""
    frames = recorded_session(plant(), controller())
    late = controller(challenge=b"ctrl-two", first_counter=10**6)
    assert accepted(late, [*frames, *reversed(frames), *frames]) == []
    peer = plant(challenge=b"planttwo", first_counter=10**6)
    for _ in range(2):
        exchange(late, peer)
    assert accepted(late, [*frames, *reversed(frames), *frames]) == []
    assert exchange(late, peer) == [PLANT_STATUS, FROM_PLANT[0]]


def test_an_old_life_of_the_sender_opens_nothing_to_a_receiver_that_lived_through_it() -> None:
    receiver, first = controller(), plant()
    frames = recorded_session(first, receiver)
    second = plant(challenge=b"planttwo", first_counter=10**6)
    for _ in range(2):
        exchange(receiver, second)
        assert accepted(receiver, frames) == []
    assert exchange(receiver, second) == [PLANT_STATUS, FROM_PLANT[0]]


def test_once_synchronised_no_old_status_changes_whom_an_end_answers() -> None:
    old = recorded_session(plant(challenge=b"plantnul"), controller(challenge=b"ctrl-nul"))
    receiver, sender = met(first_counter=10**6)
    for frame in old:
        receiver.verify(frame)
        sender.verify(frame)
        assert receiver.is_synchronised
        assert receiver.verify(sender.secure(FROM_PLANT[0])) == FROM_PLANT[0]
        assert sender.verify(receiver.secure(COMMAND)) == COMMAND


def test_a_sender_whose_clock_was_set_back_stays_refused() -> None:
    """The price of storing nothing: safe, and over when the other end is started anew."""
    receiver, first = met(first_counter=10**6)
    assert receiver.verify(first.secure(FROM_PLANT[0])) == FROM_PLANT[0]
    set_back = plant(challenge=b"planttwo", first_counter=10)
    for _ in range(5):
        assert exchange(receiver, set_back) == [Refused.REPLAYED, Refused.REPLAYED]
        assert set_back.verify(receiver.secure(COMMAND)) is Refused.UNSYNCHRONISED
    restarted = controller(challenge=b"ctrl-two", first_counter=10**6 + 10**3)
    for _ in range(2):
        verdicts = exchange(restarted, set_back)
    assert verdicts == [PLANT_STATUS, FROM_PLANT[0]]


def test_a_recording_with_the_clock_ahead_costs_the_answer_in_one_status_and_no_command() -> None:
    """It is the one old status message that is answered, as it seems newer than all accepted."""
    ahead = plant(challenge=b"plantnul", first_counter=2**50)
    recorded = ahead.secure(PLANT_STATUS)
    receiver, sender = met(first_counter=10**6)
    for verdict in (Refused.UNSYNCHRONISED, Refused.REPLAYED, Refused.REPLAYED):
        assert receiver.verify(recorded) is verdict
        assert sender.verify(receiver.secure(COMMAND)) == COMMAND
    assert sender.verify(receiver.secure(CONTROLLER_STATUS)) is Refused.UNSYNCHRONISED
    assert sender.verify(receiver.secure(CONTROLLER_STATUS)) == CONTROLLER_STATUS
    assert sender.verify(receiver.secure(COMMAND)) == COMMAND


def test_old_challenges_cost_one_answer_each_however_often_they_come_again() -> None:
    old = [plant(challenge=b"plant%03d" % run, first_counter=run) for run in range(1, 100)]
    recorded = [end.secure(PLANT_STATUS) for end in old]
    receiver, sender = controller(first_counter=10**6), plant(first_counter=10**6)
    sender.verify(receiver.secure(CONTROLLER_STATUS))
    answers = 0
    while not receiver.is_synchronised or not sender.is_synchronised:
        for frame in recorded:
            receiver.verify(frame)
        receiver.verify(sender.secure(PLANT_STATUS))
        sender.verify(receiver.secure(CONTROLLER_STATUS))
        answers += 1
    assert answers <= KEPT + 1
    for frame in recorded:
        assert receiver.verify(frame) is Refused.REPLAYED


@pytest.mark.parametrize("challenge", [b"", b"1234567", b"123456789", bytes(8)])
def test_what_is_no_challenge_is_refused(challenge: bytes) -> None:
    with pytest.raises(ValueError, match="challenge"):
        plant(challenge=challenge)


@pytest.mark.parametrize("first_counter", [-1, 2**63])
def test_a_counter_that_could_overflow_is_refused(first_counter: int) -> None:
    with pytest.raises(ValueError, match="first_counter"):
        plant(first_counter=first_counter)
