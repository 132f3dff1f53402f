"""The lengths of frames: those of a public encoder, published bounds, and what is no frame."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.closed_loop.recordings.candump_text import CandumpReader
from steer_by_wire.runtime.frame import BITRATE_SWITCH, ERROR, EXTENDED, FD, REMOTE, Frame
from steer_by_wire.runtime.frame.length_with_stuff_bits import INTERMISSION_BITS, crc15, frame_bits

ENCODED = Path(__file__).with_name("encoded_frames.txt")
"""Frames as for cansend, their bits as a hexadecimal number, and how many.

Computed once with CANFrameGenerator.h and CANFDFrameGenerator.h (ISO protocol, ESI dominant, ACK
dominant, without intermission) of github.com/pierremolinaro/codes-can, commit 3d3fb704b8ad, whose
frames were compared with those of Teensy microcontrollers. 8,000 frames agreed; 64 are here.
"""

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


def stuff(bits: str) -> str:
    """Insert the stuff bits, the one after a run of five at the very end included."""
    sent = ""
    for bit in bits:
        sent += bit
        if len(sent) >= 5 and len(set(sent[-5:])) == 1:
            sent += "10"[int(bit)]
    return sent


def test_the_crc_is_the_catalogued_crc_15_can() -> None:
    # Catalogue of parametrised CRC algorithms: check value of "123456789".
    assert crc15(b"123456789") == 0x059E


@pytest.mark.parametrize("line", ENCODED.read_text("ascii").splitlines())
def test_a_frame_is_as_long_as_from_a_public_encoder(line: str) -> None:
    text, _, length = line.split()
    entry = CandumpReader()(f"(0.0) can {text}")
    assert entry is not None
    assert sum(frame_bits(entry.frame)) == int(length)


def test_a_published_frame_has_its_published_length() -> None:
    # commaai/panda, tests/gmbitbang/test_packer.c: identifier 20, payload 01, with intermission.
    published = "0000010010100000100010000010011110111010100111111111111111"
    assert frame_bits(Frame(20, b"\x01")) == (len(published) - INTERMISSION_BITS, 0)


@given(identifiers, payloads(list(range(9))))
def test_classic_lengths_are_those_of_stuffing_bit_by_bit(
    identifier: tuple[int, int], data: bytes
) -> None:
    flags, can_id = identifier
    head = f"0{can_id:011b}000{len(data):04b}"
    if flags:
        head = f"0{can_id >> 18:011b}11{can_id & 0x3FFFF:018b}000{len(data):04b}"
    bits = head + "".join(f"{byte:08b}" for byte in data)
    crc = crc15(int(bits, 2).to_bytes(-(-len(bits) // 8), "big"))
    length = len(stuff(f"{bits}{crc:015b}")) + 1 + 2 + 7
    assert frame_bits(Frame(can_id, data, flags)) == (length, 0)


@pytest.mark.parametrize("can_id", [0, 0x100, 0x555, 0x7FF])
def test_a_remote_frame_is_recessive_in_rtr(can_id: int) -> None:
    # SOF, identifier, RTR recessive, IDE and r0 dominant, DLC, CRC; then delimiters, ACK and EOF.
    head = f"0{can_id:011b}1000000"
    crc = crc15(int(head, 2).to_bytes(3, "big"))
    length = len(stuff(f"{head}{crc:015b}")) + 1 + 2 + 7
    assert frame_bits(Frame(can_id, b"", REMOTE)) == (length, 0)


def test_an_fd_frame_has_its_fixed_stuff_bit_after_the_payload() -> None:
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
