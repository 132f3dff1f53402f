"""The functions that are written for each message: how they read, and that they do as the DBC."""

from enum import IntEnum
from textwrap import indent
from typing import NamedTuple

from e2e.p05 import e2e_p05_check, e2e_p05_protect
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.dbc.codec import packing
from steer_by_wire.dbc.codec.layout import PackedSignal, SignalLayout, packed_signal
from steer_by_wire.dbc.codec.packing import packing_of
from steer_by_wire.dbc.codec.protection import id_mark, mark_in, protect


class Mode(IntEnum):
    """Of the example."""

    OFF = 0
    ON = 1


class Example(NamedTuple):
    """One signal of each kind."""

    speed_m_s: float
    number: int
    mode: Mode


SIGNALS = {
    "speed_m_s": PackedSignal(float, 0.001, 24, 0xFFFF, 0x8000, -500, 500, None, "SPEED"),
    "number": PackedSignal(int, 1, 40, 0xF, 0, 0, 15, None, "NUMBER"),
    "mode": PackedSignal(Mode, 1, 44, 0x7, 0, 0, 1, None, "MODE"),
}


def test_the_source_reads_as_the_module_says() -> None:
    made = packing_of(Example, 8, 0x1234, SIGNALS, ValueError, "bad crc", lambda *_: "refused")
    assert indent(made.source.strip(), "    ") in str(packing.__doc__)
    payload = made.pack(Example(-0.25, 7, Mode.ON), 200)
    assert len(payload) == 8
    assert made.unpack(payload) == (Example(-0.25, 7, Mode.ON), 200)


def test_a_message_of_one_signal_without_protection_has_neither_counter_nor_crc() -> None:
    class Number(NamedTuple):
        number: int

    signals = {"number": PackedSignal(int, 1, 0, 0xFF, 0, 0, 255, None, "NUMBER")}
    made = packing_of(Number, 1, None, signals, ValueError, "bad crc", lambda *_: "refused")
    assert made.pack(Number(7), 200) == b"\x07"
    assert [made.unpack(made.pack(Number(raw), 0)) for raw in (0, 255)] == [((0,), 0), ((255,), 0)]


def test_a_number_that_an_enumeration_leaves_out_is_refused() -> None:
    class Law(IntEnum):
        PD = 0
        PID = 2

    class Status(NamedTuple):
        law: Law

    signals = {"law": PackedSignal(Law, 1, 0, 0x3, 0, 0, 2, None, "LAW")}
    made = packing_of(Status, 1, None, signals, ValueError, "bad crc", lambda *_: "refused")
    unpacked = [made.unpack(bytes([raw])) for raw in range(4)]
    assert unpacked == [((Law.PD,), 0), "refused", ((Law.PID,), 0), "refused"]


def test_a_refusal_names_no_value_beyond_the_signal_s_range() -> None:
    row = ("MODE", "mode", 44, 3, False, 1, 0, 0, "", None)
    assert packed_signal(SignalLayout._make(row), Mode).text == "MODE: allowed is one of Mode.OFF"


@given(st.binary(min_size=6, max_size=6), st.integers(0, 0xFFFF))
def test_the_crc_is_that_of_the_library_for_profile_5(content: bytes, data_id: int) -> None:
    ours, theirs = bytearray(b"\0\0" + content), bytearray(b"\0\0" + content)
    protect(ours, data_id)
    e2e_p05_protect(theirs, data_id, increment_counter=False)
    assert ours == theirs
    assert e2e_p05_check(bytes(ours), data_id)
    assert mark_in(bytes(theirs)) == id_mark(data_id)
    theirs[4] ^= 1
    assert mark_in(bytes(theirs)) != id_mark(data_id)
