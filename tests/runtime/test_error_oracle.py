"""The model's closed forms against nodes that step bit by bit on a wire."""

import random
from collections.abc import Iterator

import pytest

from steer_by_wire.runtime.disturbed_frame import Disturbed, disturb
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.frame_length import DATA_LENGTH_CODE
from steer_by_wire.runtime.frame_on_wire import WireBit, frame_on_wire
from steer_by_wire.runtime.one_sided_error import disturb_receiver, disturb_sender
from tests.support.bit_oracle import Bit, Node, transmit
from tests.support.random_frames import FORMATS

_ARBITRATION = ("ID", "SRR", "IDE", "ID extension", "RTR", "RRS")
_LAYOUT = ("IDE", "FDF", "res", "DLC", "BRS", "RTR", "RRS", "SRR", "r1", "r0", "ESI")
FRAMES = 8
_END = ("CRC delimiter", "ACK delimiter", "EOF")


def bits_of(wire: tuple[WireBit, ...]) -> list[Bit]:
    is_fd = any(bit.field == "FDF" for bit in wire)
    kinds = []
    for bit in wire:
        if bit.field in _END:
            kinds.append("end")
        elif bit.field == "ACK":
            kinds.append("ack")
        elif is_fd and bit.field in ("stuff count", "CRC"):
            kinds.append("fixed" if bit.is_stuff else "check")
        elif bit.is_stuff:
            kinds.append("stuff")
        else:
            kinds.append("arbitration" if bit.field in _ARBITRATION else "body")
    return [Bit(bit.level, kind) for bit, kind in zip(wire, kinds, strict=True)]


def random_frame(draw: random.Random, flags: int) -> Frame:
    lengths = [n for n in DATA_LENGTH_CODE if n <= 8]
    length = 0 if flags & 2 else draw.choice(lengths)
    data = bytes(draw.choice((0x00, 0xFF, 0x0F, draw.randrange(256))) for _ in range(length))
    return Frame(draw.randrange(1 << 29 if flags & 1 else 1 << 11), data, flags)


def agrees(disturbed: Disturbed, nodes: list[Node], took: int) -> bool:
    return (
        sum(disturbed.bits) == took
        and disturbed.is_transmit_error == (nodes[0].transmit_errors > 0)
        and disturbed.is_received == nodes[1].accepted
    )


def cases(flags: int, frames: int) -> Iterator[tuple[Frame, int, list[Bit]]]:
    """Random frames and each bit whose error leaves the layout as it is."""
    draw = random.Random(flags)
    for _ in range(frames):
        frame = random_frame(draw, flags)
        wire = frame_on_wire(frame)
        for index, bit in enumerate(wire):
            # The silence after a lost arbitration may look like a later standard's format.
            ends = bit.field == "ID extension" and wire[index + 8].field != "ID extension"
            if bit.field not in (*_LAYOUT, "SOF") and not ends:
                yield frame, index, bits_of(wire)


@pytest.mark.parametrize("flags", FORMATS)
def test_an_error_that_all_see_ends_as_on_the_wire_bit_by_bit(flags: int) -> None:
    for frame, index, bits in cases(flags, FRAMES):
        nodes, took = transmit(bits, (), 3, {(n, index) for n in range(3)})
        assert agrees(disturb(frame, index, is_passive=False), nodes, took), (frame, index)


@pytest.mark.parametrize("flags", FORMATS)
def test_an_error_that_the_sender_alone_sees_ends_as_on_the_wire(flags: int) -> None:
    for frame, index, bits in cases(flags, FRAMES):
        nodes, took = transmit(bits, (), 3, {(0, index)})
        disturbed = disturb_sender(frame, index, is_passive=False)
        assert agrees(disturbed, nodes, took), (frame, index)


@pytest.mark.parametrize("flags", FORMATS)
def test_an_error_that_one_receiver_alone_sees_ends_as_on_the_wire(flags: int) -> None:
    compared = shifted = 0
    for frame, index, bits in cases(flags, FRAMES):
        nodes, took = transmit(bits, (), 3, {(2, index)})
        compared += 1
        if nodes[2].is_shifted:
            shifted += 1
            continue
        disturbed = disturb_receiver(frame, index, 2, is_passive=False)
        if disturbed is None:
            assert nodes[2].accepted
            continue
        assert agrees(disturbed, nodes, took), (frame, index)
        assert not nodes[2].accepted
        assert nodes[2].receive_errors == 9, (frame, index)
        assert nodes[1].receive_errors == (0 if disturbed.is_received else 1)
    assert shifted < 0.5 * compared
