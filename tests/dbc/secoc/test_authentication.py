"""Authenticated frames: what an end with the key accepts, and what it refuses and why."""

import cantools.database
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from steer_by_wire.dbc.contract.dbc_file import load_database
from steer_by_wire.dbc.messages import CAN_IDS, LateralError, SteeringCommand
from steer_by_wire.dbc.reception import Reception
from steer_by_wire.dbc.secoc.secured_dbc import secured_dbc
from steer_by_wire.dbc.secoc.secured_frame import LAYOUTS, Refused
from steer_by_wire.runtime.frame import ERROR, EXTENDED, FD, REMOTE, Frame
from tests.support.frames.authenticated_ends import (
    CONTROLLER_CHALLENGE,
    CONTROLLER_STATUS,
    ERROR_MESSAGE,
    FROM_PLANT,
    PLANT_CHALLENGE,
    controller,
    met,
)
from tests.support.frames.counter_rules import rule

OTHER_KEY = bytes(range(1, 17))


# Both ends have the key


def test_frames_may_come_without_the_bit_rate_switch() -> None:
    controller_end, plant_end = met()
    secured = plant_end.secure(FROM_PLANT[0])
    assert controller_end.verify(secured._replace(flags=FD)) == FROM_PLANT[0]


@pytest.mark.parametrize("flags", [0, EXTENDED, REMOTE, ERROR, FD | EXTENDED, FD | REMOTE])
def test_what_is_not_of_the_secured_form_is_unauthenticated(flags: int) -> None:
    controller_end, plant_end = met()
    secured = plant_end.secure(FROM_PLANT[0])
    for length in range(65):
        wrong = Frame(secured.can_id, (secured.data * 4)[:length], flags)
        assert controller_end.verify(wrong) is Refused.UNAUTHENTICATED
    for length in (0, 8, 19, 21, 48, 64):
        wrong = Frame(secured.can_id, (secured.data * 4)[:length], FD)
        assert controller_end.verify(wrong) is Refused.UNAUTHENTICATED


@given(
    st.one_of(st.sampled_from(sorted(CAN_IDS.values())), st.integers(0, 2**29 - 1)),
    st.one_of(
        st.binary(max_size=64),
        st.binary(min_size=20, max_size=20),
        st.binary(min_size=48, max_size=48),
    ),
    st.integers(0, 31),
    st.booleans(),
)
@example(0x110, bytes(20), FD, True)
@example(0x310, bytes(48), FD, False)
def test_no_bytes_make_an_end_raise_or_accept(
    can_id: int, data: bytes, flags: int, synchronised: bool
) -> None:
    end = met()[0] if synchronised else controller()
    assert isinstance(end.verify(Frame(can_id, data, flags)), Refused)


# A recording


# Who has no key


def test_a_receiver_without_a_key_says_so() -> None:
    reception = Reception((LateralError, SteeringCommand), rule())
    _, plant_end = met()
    assert reception.receive(plant_end.secure(FROM_PLANT[0])) is Refused.NO_KEY
    assert reception.receive(FROM_PLANT[0]) == ERROR_MESSAGE
    assert reception.rejected == {"no_key": 1}


def test_the_printed_dbc_describes_every_byte_and_leaves_the_payload_as_it_was() -> None:
    database = cantools.database.load_string(secured_dbc(), "dbc", strict=True)
    assert isinstance(database, cantools.database.can.Database)
    for message in load_database().messages:
        longer = database.get_message_by_name(message.name)
        for signal in message.signals:
            same = longer.get_signal_by_name(signal.name)
            for name in ("start", "length", "byte_order", "scale", "minimum", "maximum", "choices"):
                assert getattr(same, name) == getattr(signal, name)
        if message.frame_id in LAYOUTS:
            assert longer.is_fd
            assert longer.length == LAYOUTS[message.frame_id].length
    names = [signal.name for message in database.messages for signal in message.signals]
    names += [message.name for message in database.messages]
    assert sorted(names) == sorted(set(names))
    assert max(map(len, names)) <= 32
    controller_end, plant_end = met(first_counter=2**33)
    for frame, sender in ((FROM_PLANT[0], plant_end), (CONTROLLER_STATUS, controller_end)):
        secured = sender.secure(frame)
        signals = database.decode_message(frame.can_id, secured.data)
        was = load_database().decode_message(frame.can_id, frame.data)
        assert isinstance(signals, dict)
        assert isinstance(was, dict)
        assert was.items() <= signals.items()
        layout = LAYOUTS[frame.can_id]
        on_wire = secured.data[layout.secured_length : layout.mac_start]
        name = database.get_message_by_frame_id(frame.can_id).name
        assert signals[f"{name}_MAC_COUNTER"] == int.from_bytes(on_wire, "big")
        challenges = dict(signals)
    assert challenges["CONTROLLER_STATUS_CHALLENGE"] == int.from_bytes(CONTROLLER_CHALLENGE, "big")
    assert challenges["CONTROLLER_STATUS_ECHO"] == int.from_bytes(PLANT_CHALLENGE, "big")
