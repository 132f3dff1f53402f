"""What a receiver makes of right and of disturbed bits."""

from collections import Counter

import pytest
from hypothesis import given

from steer_by_wire.runtime.frame import BITRATE_SWITCH, EXTENDED, FD, REMOTE, Frame
from steer_by_wire.runtime.frame.received_bits import WireError, receive
from steer_by_wire.runtime.frame.wire_bits import CRC_15, WireBit, crc_of, frame_on_wire
from tests.support.wire.random_frames import frames_on_a_bus

ONE_OF_EACH_FORMAT = (
    Frame(0x100, bytes.fromhex("0123456789ABCDEF")),
    Frame(0x1ABCDEF0, bytes.fromhex("00FF00"), EXTENDED),
    Frame(0x7FF, b"", REMOTE),
    Frame(0, b"", REMOTE | EXTENDED),
    Frame(0x123, bytes(12), FD),
    Frame(0x0ABCDEF0, bytes.fromhex("FFFF0000"), FD | EXTENDED),
    Frame(0x300, bytes(range(20)), FD | BITRATE_SWITCH),
    Frame(0x1FFFFFFF, b"\xff" * 8, FD | BITRATE_SWITCH | EXTENDED),
)


def levels(bits: tuple[WireBit, ...]) -> list[int]:
    return [bit.level for bit in bits]


@given(frames_on_a_bus())
def test_what_is_sent_is_received_at_the_last_but_one_bit(frame: Frame) -> None:
    bits = levels(frame_on_wire(frame))
    assert receive(bits) == (frame, None, len(bits) - 2)


@pytest.mark.parametrize("frame", ONE_OF_EACH_FORMAT)
def test_one_flipped_bit_is_found_wherever_it_is(frame: Frame) -> None:
    bits = frame_on_wire(frame)
    for index, bit in enumerate(bits):
        disturbed = levels(bits)
        disturbed[index] = 1 - bit.level
        reception = receive(disturbed)
        # The receiver does not use the acknowledgement, and has accepted before the last bit.
        if bit.field == "ACK" or index == len(bits) - 1:
            assert reception.frame == frame
        else:
            assert reception.error is not None, (index, bit)


def test_each_error_is_named_where_it_is_found() -> None:
    frame = Frame(0, b"\xa5")
    bits = frame_on_wire(frame)
    kinds: Counter[WireError | None] = Counter()
    for index in range(len(bits)):
        disturbed = levels(bits)
        disturbed[index] ^= 1
        reception = receive(disturbed)
        kinds[reception.error] += 1
        if bits[index].is_stuff:
            assert reception == (None, WireError.STUFF, index)
        if bits[index].field in ("CRC delimiter", "ACK delimiter"):
            assert reception == (None, WireError.FORM, index)
    assert kinds[WireError.CRC] > 0
    assert kinds[None] == 2


def test_a_crc_error_is_reported_after_the_acknowledge_delimiter() -> None:
    bits = frame_on_wire(Frame(0x555, b"\x55\x55"))
    index = [bit.field for bit in bits].index("data")
    disturbed = levels(bits)
    disturbed[index + 3] ^= 1
    delimiter = [bit.field for bit in bits].index("ACK delimiter")
    assert receive(disturbed) == (None, WireError.CRC, delimiter)


def test_bits_that_end_within_a_frame_are_incomplete() -> None:
    assert receive([0, 1, 0]).error is WireError.INCOMPLETE


def test_a_data_length_code_above_eight_of_a_classic_frame_means_eight() -> None:
    # The header with DLC 15 instead of 8 has another CRC and other stuff bits: encoded by hand.
    head = [0, *[1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1], 0, 0, 0, 1, 1, 1, 1, *[0, 1] * 32]
    crc = crc_of(CRC_15, head)
    unstuffed = [*head, *[crc >> shift & 1 for shift in range(14, -1, -1)]]
    stuffed: list[int] = []
    for level in unstuffed:
        stuffed.append(level)
        if len(stuffed) >= 5 and len(set(stuffed[-5:])) == 1:
            stuffed.append(1 - level)
    received = receive([*stuffed, 1, 0, 1, *[1] * 7])
    assert received.frame == Frame(0x555, b"\x55" * 8)
