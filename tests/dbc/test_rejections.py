"""Frames that are no message: whatever arrives, decode names the cause and never raises."""

from itertools import combinations

import pytest
from cantools.database.can import Message as Definition
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.dbc.codec.protection import header_bits, protect
from steer_by_wire.dbc.contract.dbc_file import load_database
from steer_by_wire.dbc.messages import (
    CAN_IDS,
    DATA_IDS,
    MESSAGE_TYPES,
    REVISIONS,
    Decoded,
    Rejection,
    decode,
    encode,
    encode_not_available,
    frame_of,
)
from steer_by_wire.runtime.frame import BITRATE_SWITCH, ERROR, EXTENDED, FD, REMOTE, Frame
from tests.support.frames.made_messages import command_of

MESSAGES = load_database().messages
LENGTH_MAX = max(message.length for message in MESSAGES)
PROTECTED = [each for each in MESSAGES if MESSAGE_TYPES[each.name] in DATA_IDS]
COMMAND = command_of(0.12345, 1234)
PAYLOAD = encode(COMMAND, 0).data
NOT_INTACT = {Rejection.BAD_CRC, Rejection.MASQUERADED, Rejection.OTHER_REVISION}

message_frames = st.builds(
    Frame, st.sampled_from(list(CAN_IDS.values())), st.binary(min_size=7, max_size=8), st.just(0)
)
all_frames = st.builds(Frame, st.integers(0, 2**29 - 1), st.binary(max_size=64), st.integers(0, 31))


def frame_of_raws(definition: Definition, raws: dict[str, int]) -> Frame:
    """A frame with a good CRC and these raw integers, packed by cantools; 1 where none is given."""
    ones = {signal.name: 1 for signal in definition.signals}
    payload = bytearray(definition.encode(ones | raws, scaling=False, strict=False))
    if definition in PROTECTED:
        assert definition.dbc is not None
        protect(payload, int(definition.dbc.attributes["E2EDataId"].value))
    return frame_of(definition.frame_id, bytes(payload))


@given(message_frames | all_frames)
def test_any_frame_is_a_message_or_a_named_rejection(frame: Frame) -> None:
    assert isinstance(decode(frame), Decoded | Rejection)


@given(st.binary(min_size=LENGTH_MAX, max_size=LENGTH_MAX))
def test_a_good_crc_does_not_make_any_payload_a_message(content: bytes) -> None:
    expected = {Rejection.OUT_OF_RANGE, Rejection.NOT_AVAILABLE}
    for definition in MESSAGES:
        payload = bytearray(content[: definition.length])
        if definition in PROTECTED:
            assert definition.dbc is not None
            protect(payload, int(definition.dbc.attributes["E2EDataId"].value))
        decoded = decode(frame_of(definition.frame_id, bytes(payload)))
        assert isinstance(decoded, Decoded) or decoded in expected, definition.name


@pytest.mark.parametrize(
    ("frame", "cause"),
    [
        (Frame(0x102, PAYLOAD), Rejection.UNKNOWN_ID),
        (Frame(0x102, PAYLOAD, EXTENDED), Rejection.UNKNOWN_ID),
        (Frame(0x100, PAYLOAD, EXTENDED), Rejection.WRONG_FORMAT),
        (Frame(0x100, b"", REMOTE), Rejection.WRONG_FORMAT),
        (Frame(0x100, PAYLOAD, ERROR), Rejection.WRONG_FORMAT),
        (Frame(0x004, bytes(8), ERROR), Rejection.WRONG_FORMAT),
        (Frame(0x100, PAYLOAD, FD), Rejection.WRONG_FORMAT),
        (Frame(0x100, PAYLOAD, FD | BITRATE_SWITCH), Rejection.WRONG_FORMAT),
        (Frame(0x100, PAYLOAD + bytes(4), FD), Rejection.WRONG_LENGTH),
        (Frame(0x100, PAYLOAD[:7]), Rejection.WRONG_LENGTH),
        (Frame(0x100, b""), Rejection.WRONG_LENGTH),
        (Frame(0x101, bytes(48)), Rejection.WRONG_FORMAT),
        (Frame(0x101, bytes(48), FD | BITRATE_SWITCH), Rejection.BAD_CRC),
        (Frame(0x101, PAYLOAD), Rejection.WRONG_LENGTH),
        (Frame(0x100, bytes(8)), Rejection.BAD_CRC),
        (Frame(0x320, bytes.fromhex("23 2003 2c01 1127")), Rejection.OUT_OF_RANGE),  # loss 1.0001
        (Frame(0x320, bytes.fromhex("20 2003 2c01 6400")), Rejection.OUT_OF_RANGE),  # direction 0
        (Frame(0x320, bytes.fromhex("53 2003 2c01 6400")), Rejection.OUT_OF_RANGE),  # model 5
        (encode_not_available(COMMAND, 0), Rejection.NOT_AVAILABLE),
    ],
    ids=str,
)
def test_a_bad_frame_is_rejected_by_its_cause(frame: Frame, cause: Rejection) -> None:
    assert decode(frame) is cause


@pytest.mark.parametrize("definition", MESSAGES, ids=lambda message: str(message.name))
def test_the_range_of_every_signal_ends_where_the_dbc_says(definition: Definition) -> None:
    for signal in definition.signals:
        if signal.name in header_bits(definition.name):
            continue
        assert signal.minimum is not None
        assert signal.maximum is not None
        low, high = round(signal.minimum / signal.scale), round(signal.maximum / signal.scale)
        lowest = -(1 << signal.length - 1) if signal.is_signed else 0
        highest = lowest + (1 << signal.length) - 1
        not_available = {raw for raw, name in (signal.choices or {}).items() if raw < low}
        edges = {lowest, low - 1, low, high, high + 1, highest}
        for raw in [raw for raw in edges if lowest <= raw <= highest]:
            decoded = decode(frame_of_raws(definition, {signal.name: raw}))
            if low <= raw <= high:
                assert isinstance(decoded, Decoded), (signal.name, raw)
            elif raw in not_available:
                assert decoded is Rejection.NOT_AVAILABLE, (signal.name, raw)
            else:
                assert decoded is Rejection.OUT_OF_RANGE, (signal.name, raw)


def flip(payload: bytes, bits: tuple[int, ...]) -> bytes:
    word = int.from_bytes(payload, "little")
    for bit in bits:
        word ^= 1 << bit
    return word.to_bytes(len(payload), "little")


@pytest.mark.parametrize("definition", PROTECTED, ids=lambda message: str(message.name))
def test_one_or_two_flipped_bits_of_a_protected_frame_are_always_found(
    definition: Definition,
) -> None:
    frame = frame_of_raws(definition, {})
    assert isinstance(decode(frame), Decoded)
    for count in (1, 2):
        for bits in combinations(range(8 * len(frame.data)), count):
            assert decode(frame._replace(data=flip(frame.data, bits))) in NOT_INTACT


@pytest.mark.parametrize("bit", REVISIONS)
@pytest.mark.parametrize("definition", PROTECTED, ids=lambda message: str(message.name))
def test_a_message_of_another_revision_of_the_dbc_is_known_as_such(
    definition: Definition, bit: int
) -> None:
    frame = frame_of_raws(definition, {})
    payload = bytearray(frame.data)
    protect(payload, DATA_IDS[MESSAGE_TYPES[definition.name]] ^ bit)
    assert decode(frame._replace(data=bytes(payload))) is Rejection.OTHER_REVISION
