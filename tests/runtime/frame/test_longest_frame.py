"""The longest frames of a message."""

import random

import pytest

from steer_by_wire.runtime.frame import BITRATE_SWITCH, EXTENDED, FD, Frame
from steer_by_wire.runtime.frame.length_with_stuff_bits import frame_bits, most_frame_bits


@pytest.mark.parametrize(
    ("flags", "length", "bits"), [(0, 8, 135), (0, 0, 55), (EXTENDED, 8, 160), (EXTENDED, 0, 80)]
)
def test_the_bound_of_a_classic_frame_is_the_one_in_the_literature(
    flags: int, length: int, bits: int
) -> None:
    # Davis et al. 2007, equations (1) and (2), with the three bits of intermission.
    assert most_frame_bits(Frame(0x123, bytes(length), flags)) == (bits - 3, 0)


@pytest.mark.parametrize("flags", [0, EXTENDED, FD, FD | BITRATE_SWITCH])
@pytest.mark.parametrize("can_id", [0, 0x100, 0x7FF])
def test_no_payload_exceeds_the_bound_and_one_comes_near(can_id: int, flags: int) -> None:
    draw, longest = random.Random(can_id + flags), 0
    bound = most_frame_bits(Frame(can_id, bytes(8), flags))
    for _ in range(200):
        payload = bytes(draw.choice((0x00, 0xFF, 0x0F, draw.randrange(256))) for _ in range(8))
        for frame in (
            Frame(can_id, payload, flags),
            Frame(can_id, b"\xf0" * 7 + payload[:1], flags),
        ):
            bits = frame_bits(frame)
            assert bits.nominal <= bound.nominal
            assert sum(bits) <= sum(bound)
            longest = max(longest, sum(bits))
    assert 0.9 * sum(bound) < longest
