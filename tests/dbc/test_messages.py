"""Messages to frames and back: golden bytes, agreement with cantools, every kind of bad frame."""

import math
from collections.abc import Callable, Iterator
from enum import IntEnum
from typing import Any, get_type_hints

import pytest
from cantools.database.can.signal import Signal
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.dbc.codec.protection import header_bits
from steer_by_wire.dbc.contract.dbc_file import field_name, load_database
from steer_by_wire.dbc.messages import (
    DATA_IDS,
    MESSAGE_TYPES,
    Decoded,
    Direction,
    EncodeError,
    LatencyModel,
    LateralError,
    Message,
    Mode,
    Rejection,
    decode,
    encode,
    encode_not_available,
    frame_of,
    limits,
)
from tests.support.frames.made_messages import (
    command_of,
    error_of,
    latency_of,
    message_with,
    motion_of,
    plan_of,
)

DATABASE = load_database()
NAMES = {message_type: name for name, message_type in MESSAGE_TYPES.items()}
COMMAND = command_of(0.12345, 1234)


def field_values(message_type: type[Message], field: str, kind: type) -> st.SearchStrategy[Any]:
    low, high = limits(message_type)[field]
    if issubclass(kind, IntEnum):
        return st.sampled_from(kind)
    return st.floats(low, high) if kind is float else st.integers(int(low), int(high))


def records(message_type: type[Message]) -> st.SearchStrategy[Message]:
    hints = get_type_hints(message_type)
    values = {name: field_values(message_type, name, kind) for name, kind in hints.items()}
    build: Callable[..., Message] = message_type
    return st.builds(build, **values)


messages = st.one_of([records(message_type) for message_type in MESSAGE_TYPES.values()])
counters = st.integers(0, 255)


def signals_of(message: Message) -> dict[str, Signal]:
    """The DBC's signals by the name of the field that stands for them."""
    definition = DATABASE.get_message_by_name(NAMES[type(message)])
    fields = {field_name(definition, signal): signal for signal in definition.signals}
    return {name: fields[name] for name in message._fields}


# Payload behind the two CRC bytes and the counter, worked out by hand from the bit positions:
# sum of raw << (first bit - 24), low byte first; one message of each format. The CRC is checked
# against a library's in test_packing, and the other messages against cantools below.
GOLDEN: list[tuple[Message, str, str]] = [
    # 12345 = 0x3039; 1234 << 18 = 0x1348_0000; 1 << 34 = 0x4_0000_0000; sum 0x04_1348_3039
    (COMMAND, "100", "c1ae 07 3930481304"),
    # -50000 = 0x33CB0 in 18 bits; 65535 << 18 = 0x3_FFFC_0000; 3 << 34; sum 0x0F_FFFF_3CB0
    (command_of(-0.5, 65535, Mode.SAFE_STOP), "100", "d457 07 b03cffff0f"),
    # 1234 = 0x04D2; 1 << 16; 200 << 19 = 0x640_0000; 5 << 27; 1000 << 31, -1000 << 49, 0 to 17 more
    (
        plan_of([0.01, -0.01, *[0.0] * 16], plan_number=1234, first_sample=200, spacing=5),
        "101",
        "fe02 07 d204412ef40130f807" + 36 * "00",
    ),
    # -2000 = 0x1FF_F830 in 25 bits; 100 << 25 = 0xC800_0000; sum 0x00_C9FF_F830
    (
        message_with(LateralError, lateral_error_m=-0.01, heading_error_rad=0.02),
        "110",
        "8e60 07 30f8ffc900",
    ),
    # 3 + (2 << 4) = 0x23; 800 = 0x0320; 300 = 0x012C; 100 = 0x0064; no CRC, no counter
    (
        latency_of(Direction.BOTH, 0.08, 0.03, 0.01, model=LatencyModel.NORMAL),
        "320",
        "23 2003 2c01 6400",
    ),
]


@pytest.mark.parametrize(("message", "can_id", "payload"), GOLDEN, ids=lambda value: str(value))
def test_a_message_has_the_bytes_worked_out_by_hand(
    message: Message, can_id: str, payload: str
) -> None:
    frame = encode(message, 7)
    assert frame == frame_of(int(can_id, 16), bytes.fromhex(payload))
    decoded = decode(frame)
    assert isinstance(decoded, Decoded)
    assert decoded.message == pytest.approx(message, abs=1e-12)
    assert decoded.counter == (0 if type(message) not in DATA_IDS else 7)


@given(messages, counters)
def test_a_round_trip_moves_no_value_by_more_than_half_a_resolution(
    message: Message, counter: int
) -> None:
    decoded = decode(encode(message, counter))
    assert isinstance(decoded, Decoded)
    assert type(decoded.message) is type(message)
    for name, signal in signals_of(message).items():
        sent, received = getattr(message, name), getattr(decoded.message, name)
        assert type(received) is type(sent)
        half = signal.scale / 2 if isinstance(sent, float) else 0
        assert abs(received - sent) <= half * (1 + 1e-6)


@given(messages, counters)
def test_cantools_packs_the_same_bytes_and_unpacks_the_same_values(
    message: Message, counter: int
) -> None:
    frame = encode(message, counter)
    decoded = decode(frame)
    assert isinstance(decoded, Decoded)
    definition = DATABASE.get_message_by_frame_id(frame.can_id)
    theirs = definition.decode(frame.data, decode_choices=False)
    assert isinstance(theirs, dict)
    names = {signal.name: name for name, signal in signals_of(message).items()}
    for signal_name, name in names.items():
        assert theirs[signal_name] == getattr(decoded.message, name)
    header = {name: value for name, value in theirs.items() if name in header_bits(definition.name)}
    values = {signal_name: getattr(message, name) for signal_name, name in names.items()}
    assert definition.encode(header | values) == frame.data


def name_and_value_that_do_not_fit() -> Iterator[tuple[Message, str, object]]:
    """For every field: a message that fits, and values for that field that do not."""
    for message in map(message_with, MESSAGE_TYPES.values()):
        for name, signal in signals_of(message).items():
            low, high = limits(type(message))[name]
            if isinstance(getattr(message, name), IntEnum):
                wrong: list[object] = [high + 1, low, SomeOtherEnum(int(low)), None, "ACTIVE"]
            elif isinstance(getattr(message, name), float):
                wrong = [math.nan, math.inf, -math.inf, None, "0.1"]
                wrong += [low - 0.51 * signal.scale, high + 0.51 * signal.scale]
            else:
                wrong = [low - 1, high + 1, 1.0, math.nan, None, "1"]
            for value in wrong:
                yield message, name, value


class SomeOtherEnum(IntEnum):
    ZERO = 0
    ONE = 1


def test_encode_refuses_what_a_signal_cannot_carry_and_names_it() -> None:
    for message, name, value in name_and_value_that_do_not_fit():
        signal = signals_of(message)[name]
        with pytest.raises(EncodeError) as caught:
            encode(message._replace(**{name: value}), 0)
        text = str(caught.value)
        assert text.startswith(f"{NAMES[type(message)]}.{signal.name}: allowed is "), text
        assert text.endswith(f", not {value!r}"), text


def test_an_encode_error_says_what_is_allowed() -> None:
    with pytest.raises(EncodeError) as caught:
        encode(command_of(2.0), 0)
    expected = "STEERING_COMMAND.STEER: allowed is -1.31071 to 1.31071 rad, not 2.0"
    assert str(caught.value) == expected


@pytest.mark.parametrize("counter", [-1, 256])
def test_a_counter_beyond_eight_bits_is_refused(counter: int) -> None:
    with pytest.raises(EncodeError, match="COUNTER: allowed is 0 to 255"):
        encode(COMMAND, counter)


def test_not_available_is_the_lowest_raw_and_leaves_the_other_fields_alone() -> None:
    command = encode_not_available(COMMAND, 7)
    # -131072 = 0x20000 in 18 bits; the rest as in the first golden frame: 0x04_134A_0000
    assert command.data[3:].hex() == "00004a1304"
    error = encode_not_available(error_of(), 7)
    # 0x100_0000 in 25 bits; 0x4000 in 15 bits, << 25
    assert error.data[3:].hex() == "0000000180"
    assert decode(command) is decode(error) is Rejection.NOT_AVAILABLE


def test_a_message_that_is_always_available_cannot_say_otherwise() -> None:
    with pytest.raises(EncodeError, match="VEHICLE_STATE: none of its signals"):
        encode_not_available(motion_of(1.0), 0)
