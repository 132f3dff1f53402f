"""The bits of a frame, against a public encoder's and the lengths that the bus model uses."""

from pathlib import Path

import pytest
from hypothesis import given

from steer_by_wire.runtime.frame import FD, Frame
from steer_by_wire.runtime.frame.length_with_stuff_bits import crc15, frame_bits
from steer_by_wire.runtime.frame.wire_bits import CRC_15, crc_of, frame_on_wire, stuff_count
from steer_by_wire.runtime.recording.candump import parse_entry
from tests.support.wire.random_frames import frames_on_a_bus

ENCODED = Path(__file__).with_name("encoded_frames.txt")
"""Frames as for cansend, their bits as a hexadecimal number, and how many.

Computed once with CANFrameGenerator.h and CANFDFrameGenerator.h (ISO protocol, ESI dominant, ACK
dominant, without intermission) of github.com/pierremolinaro/codes-can, commit 3d3fb704b8ad, whose
frames were compared with those of Teensy microcontrollers. 8,000 frames agreed; 64 are here.
"""


def _encoded() -> list[tuple[str, str]]:
    lines = (line.split() for line in ENCODED.read_text("ascii").splitlines())
    return [(frame, f"{int(bits, 16):0{length}b}") for frame, bits, length in lines]


@pytest.mark.parametrize(("text", "bits"), _encoded())
def test_the_bits_are_those_of_a_public_encoder(text: str, bits: str) -> None:
    entry = parse_entry(f"(0.0) can {text}")
    assert entry is not None
    assert "".join(str(bit.level) for bit in frame_on_wire(entry.frame)) == bits


@given(frames_on_a_bus())
def test_the_lengths_are_those_that_the_bus_model_uses(frame: Frame) -> None:
    bits = frame_on_wire(frame)
    fast = sum(bit.is_fast for bit in bits)
    assert (len(bits) - fast, fast) == frame_bits(frame)


@given(frames_on_a_bus())
def test_six_equal_bits_are_nowhere_before_the_end(frame: Frame) -> None:
    bits = frame_on_wire(frame)
    text = "".join(str(bit.level) for bit in bits if bit.field not in ("ACK delimiter", "EOF"))
    assert "000000" not in text
    assert "111111" not in text


def test_a_frame_by_hand() -> None:
    fields = [(bit.field, bit.level, bit.is_stuff) for bit in frame_on_wire(Frame(0, b""))]
    # Start of frame and four bits of the identifier are five dominant ones.
    assert fields[:6] == [("SOF", 0, False), *[("ID", 0, False)] * 4, ("ID", 1, True)]
    assert fields[-9:] == [("ACK", 0, False), ("ACK delimiter", 1, False), *[("EOF", 1, False)] * 7]


def test_both_ways_to_the_classic_crc_agree() -> None:
    message = bytes(range(40))
    levels = [byte >> shift & 1 for byte in message for shift in range(7, -1, -1)]
    assert crc_of(CRC_15, levels) == crc15(message)


def test_the_stuff_count_is_a_gray_code_with_even_parity() -> None:
    codes = [stuff_count(count) for count in range(9)]
    assert codes == [0b0000, 0b0011, 0b0110, 0b0101, 0b1100, 0b1111, 0b1010, 0b1001, 0b0000]


@pytest.mark.parametrize("frame", [Frame(0x800, b""), Frame(1, bytes(9)), Frame(1, bytes(9), FD)])
def test_what_is_no_frame_is_refused(frame: Frame) -> None:
    with pytest.raises(ValueError, match="frame"):
        frame_on_wire(frame)
