"""The functions that are written for each message: how they read, and that they do as the DBC."""

from enum import IntEnum
from textwrap import dedent, indent
from typing import Any, NamedTuple

import pytest
from e2e.p05 import e2e_p05_check, e2e_p05_protect
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.dbc.codec import packing
from steer_by_wire.dbc.codec.codec import MessageCodec
from steer_by_wire.dbc.codec.layout import PackedSignal
from steer_by_wire.dbc.codec.packing import packing_of
from steer_by_wire.dbc.codec.protection import id_mark, mark_in, protect
from steer_by_wire.dbc.contract.dbc_file import load_database
from steer_by_wire.dbc.contract.generated_layout import LAYOUTS
from steer_by_wire.dbc.messages import MESSAGE_TYPES

DATABASE = load_database()
LAYOUT_OF = {layout.name: layout for layout in LAYOUTS}


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
    assert made.source == dedent(
        """\
        def pack(message, counter):
            try:
                number, = message
                number = index(number)
                if (
                    0 <= number <= 255
                ):
                    return (
                        number
                    ).to_bytes(1, 'little')
            except (TypeError, ValueError, OverflowError):
                pass
            raise cannot_send(message, counter)

        def unpack(payload):
            word = from_bytes(payload, 'little')
            number = word & 0xff
            if (
                True
            ):
                return new(Message, (number,)), 0
            return refusal(number)
        """
    )
    assert [made.unpack(made.pack(Number(raw), 0)) for raw in (0, 255)] == [
        ((0,), 0),
        ((255,), 0),
    ]


@pytest.mark.parametrize("name", MESSAGE_TYPES)
@given(data=st.data())
def test_any_raws_are_what_cantools_makes_of_them(name: str, data: st.DataObject) -> None:
    codec = MessageCodec(LAYOUT_OF[name], MESSAGE_TYPES[name])
    values: list[Any] = []
    for signal in codec._signals.values():
        if issubclass(signal.kind, IntEnum):
            values.append(data.draw(st.sampled_from(list(signal.kind))))
        else:
            raw = data.draw(st.integers(signal.raw_minimum, signal.raw_maximum))
            values.append(raw * signal.resolution)
    counter = data.draw(st.integers(0, 255))
    message = MESSAGE_TYPES[name](*values)
    payload = codec.pack(message, counter)
    reported = DATABASE.get_message_by_name(name).decode(payload, decode_choices=False)
    assert isinstance(reported, dict)
    assert list(reported.values())[-len(values) :] == pytest.approx(values)
    assert codec.unpack(payload) == (message, 0 if codec.data_id is None else counter)


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
