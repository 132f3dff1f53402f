"""The byte tables against frames written out bit by bit, a published frame and published bounds."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from steer_by_wire.runtime.frame import BITRATE_SWITCH, ERROR, EXTENDED, FD, REMOTE, Frame
from steer_by_wire.runtime.frame.length import INTERMISSION_BITS, FrameBits, crc15, frame_bits

FD_LENGTHS = [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64]

identifiers = st.one_of(
    st.tuples(st.just(0), st.integers(0, 0x7FF)),
    st.tuples(st.just(EXTENDED), st.integers(0, 0x1FFFFFFF)),
)
# Bytes with long runs, where stuffing happens, and any bytes.
stuffy_bytes = st.sampled_from([0x00, 0xFF, 0x0F, 0xF0, 0x1F, 0x83, 0x7C, 0x55])
any_bytes = st.integers(0, 255)


@st.composite
def payloads(draw: st.DrawFn, lengths: list[int]) -> bytes:
    length = draw(st.sampled_from(lengths))
    byte = draw(st.sampled_from([stuffy_bytes, any_bytes]))
    return bytes(draw(st.lists(byte, min_size=length, max_size=length)))


def to_bits(value: int, width: int) -> str:
    return f"{value:0{width}b}"


def stuff(bits: str) -> str:
    """Insert the stuff bits, the one after a run of five at the very end included."""
    sent = ""
    for bit in bits:
        sent += bit
        if len(sent) >= 5 and len(set(sent[-5:])) == 1:
            sent += "10"[int(bit)]
    return sent


def reference_crc15(bits: str) -> str:
    """The shift register of the CAN 2.0 specification, section 3.1.1."""
    register = 0
    for bit in bits:
        feedback = int(bit) ^ register >> 14
        register = register << 1 & 0x7FFF
        if feedback:
            register ^= 0x4599
    return to_bits(register, 15)


def payload_bits(frame: Frame) -> str:
    return "".join(to_bits(byte, 8) for byte in frame.data)


def classic_on_the_wire(frame: Frame) -> str:
    """Every bit the sender of a classic frame writes: its acknowledge slot is recessive."""
    rtr = "1" if frame.flags & REMOTE else "0"
    dlc = to_bits(len(frame.data), 4)
    if frame.flags & EXTENDED:
        can_id = to_bits(frame.can_id, 29)
        head = "0" + can_id[:11] + "11" + can_id[11:] + rtr + "00" + dlc
    else:
        head = "0" + to_bits(frame.can_id, 11) + rtr + "00" + dlc
    message = head + payload_bits(frame)
    return stuff(message + reference_crc15(message)) + "1" + "11" + "1" * 7


def fd_on_the_wire(frame: Frame) -> tuple[str, str, str]:
    """The bits the sender of an FD frame writes: until BRS, ESI to CRC delimiter, and the rest.

    The CRC's own value is left at zero: no stuff bit depends on it.
    """
    brs = "1" if frame.flags & BITRATE_SWITCH else "0"
    if frame.flags & EXTENDED:
        can_id = to_bits(frame.can_id, 29)
        until_brs = "0" + can_id[:11] + "11" + can_id[11:] + "0" + "10" + brs
    else:
        until_brs = "0" + to_bits(frame.can_id, 11) + "00" + "10" + brs
    message = until_brs + "0" + to_bits(FD_LENGTHS.index(len(frame.data)), 4) + payload_bits(frame)
    # The first fixed stuff bit takes the place of a stuff bit after a run of five at the end: stuff
    # up to the last bit only, and append that one.
    last, stuffed = message[-1], stuff(message[:-1])
    stuff_bits = len(stuffed) + 1 - len(message)
    gray = stuff_bits % 8 ^ stuff_bits % 8 >> 1
    crc_bits = 17 if len(frame.data) <= 16 else 21
    check = to_bits(gray, 3) + str(gray.bit_count() % 2) + "0" * crc_bits
    sent = stuffed + last
    for start in range(0, len(check), 4):
        sent += "10"[int(sent[-1])] + check[start : start + 4]
    # The last group is one bit without a fixed stuff bit after it: 21 = 5 * 4 + 1, 25 = 6 * 4 + 1.
    sent += "1"
    until_brs_sent = stuff(until_brs[:-1]) + brs
    return until_brs_sent, sent[len(until_brs_sent) :], "11" + "1" * 7


def test_the_crc_is_the_catalogued_crc_15_can() -> None:
    # Catalogue of parametrised CRC algorithms: check value of "123456789".
    assert crc15(b"123456789") == 0x059E


def test_a_published_frame_has_its_published_bits() -> None:
    # commaai/panda, tests/gmbitbang/test_packer.c: identifier 20, payload 01, with intermission.
    published = "0000010010100000100010000010011110111010100111111111111111"
    frame = Frame(20, b"\x01")
    assert classic_on_the_wire(frame) + "1" * INTERMISSION_BITS == published
    assert frame_bits(frame).nominal + INTERMISSION_BITS == len(published)


@settings(deadline=None, max_examples=500)
@given(identifiers, payloads(list(range(9))))
def test_classic_data_frames_are_as_long_as_their_bits(
    identifier: tuple[int, int], data: bytes
) -> None:
    flags, can_id = identifier
    frame = Frame(can_id, data, flags)
    assert frame_bits(frame) == FrameBits(len(classic_on_the_wire(frame)), 0)


@given(st.integers(0, 0x7FF), st.lists(st.one_of(stuffy_bytes, any_bytes), min_size=8, max_size=8))
def test_the_frame_that_is_written_out_is_as_long_as_its_bits(can_id: int, data: list[int]) -> None:
    frame = Frame(can_id, bytes(data))
    assert frame_bits(frame) == FrameBits(len(classic_on_the_wire(frame)), 0)


@settings(deadline=None)
@given(identifiers)
def test_remote_frames_are_as_long_as_their_bits(identifier: tuple[int, int]) -> None:
    flags, can_id = identifier
    frame = Frame(can_id, b"", flags | REMOTE)
    assert frame_bits(frame) == FrameBits(len(classic_on_the_wire(frame)), 0)


@settings(deadline=None)
@given(identifiers, payloads(list(range(9))))
def test_classic_lengths_keep_the_published_bounds(
    identifier: tuple[int, int], data: bytes
) -> None:
    # Davis et al., "CAN schedulability analysis: refuted, revisited and revised", Real-Time Systems
    # 35 (2007): 47 + 8n unstuffed and 55 + 10n at worst with 11 bits, 67 + 8n and 80 + 10n with 29.
    flags, can_id = identifier
    unstuffed, worst = (67, 80) if flags else (47, 55)
    bits = frame_bits(Frame(can_id, data, flags)).nominal + INTERMISSION_BITS
    assert unstuffed + 8 * len(data) <= bits <= worst + 10 * len(data)


def test_a_frame_without_a_run_of_five_gets_no_stuff_bit() -> None:
    assert frame_bits(Frame(0x7BA, b"\x55" * 8)).nominal + INTERMISSION_BITS == 111


def test_a_frame_of_zeros_gets_a_stuff_bit_after_every_five() -> None:
    # 15 zeros before the one of the DLC (8), 67 after it, and a CRC without a run of five.
    assert frame_bits(Frame(0, bytes(8))) == FrameBits(108 + 15 // 5 + 67 // 5, 0)


@settings(deadline=None, max_examples=300)
@given(identifiers, payloads(FD_LENGTHS), st.booleans())
def test_fd_frames_are_as_long_as_their_bits_at_each_rate(
    identifier: tuple[int, int], data: bytes, switches: bool
) -> None:
    flags, can_id = identifier
    frame = Frame(can_id, data, flags | FD | (BITRATE_SWITCH if switches else 0))
    until_brs, after_brs, trailer = map(len, fd_on_the_wire(frame))
    if switches:
        assert frame_bits(frame) == FrameBits(until_brs + trailer, after_brs)
    else:
        assert frame_bits(frame) == FrameBits(until_brs + after_brs + trailer, 0)


def test_the_fixed_stuff_bit_of_an_fd_frame_takes_the_place_of_one_after_the_payload() -> None:
    # Payload 1F ends in a run of five, payload 0F in one of four.
    assert frame_bits(Frame(0x555, b"\x1f", FD)) == frame_bits(Frame(0x555, b"\x0f", FD))


@pytest.mark.parametrize(
    "frame",
    [
        Frame(0x800, b""),
        Frame(-1, b""),
        Frame(0x20000000, b"", EXTENDED),
        Frame(1, bytes(9)),
        Frame(1, bytes(12)),
        Frame(1, bytes(9), FD),
        Frame(1, bytes(65), FD),
        Frame(1, b"\0", REMOTE),
        Frame(1, b"", REMOTE | FD),
        Frame(1, b"", BITRATE_SWITCH),
        Frame(4, bytes(8), ERROR),
    ],
)
def test_what_is_not_a_frame_is_refused(frame: Frame) -> None:
    with pytest.raises(ValueError, match="frame"):
        frame_bits(frame)
