"""The longest frames of a message: a bound for any payload, and payloads that come near.

No payload need reach the bound, because the CRC is not free to choose.
"""

import random
from collections.abc import Iterator
from typing import NamedTuple

from .frame import Frame
from .length_with_stuff_bits import FrameBits, frame_bits, most_frame_bits

_PATTERNS = (0x0F0F, 0x1E1E, 0x3C3C, 0x7878, 0xF0F0, 0xE1E1, 0xC3C3, 0x8787, 0x0000, 0xFFFF)
"""Four equal bits in turn, in every position, and equal bits throughout."""
_ENDINGS = 200


class LongestFrame(NamedTuple):
    """How long a message can be.

    ``bound``  bits that no payload exceeds
    ``found``  bits of the longest one found, which is ``frame``
    """

    bound: FrameBits
    found: FrameBits
    frame: Frame


def longest_frame(can_id: int, length: int, flags: int) -> LongestFrame:
    """Return the bound, and the longest of some hundred payloads of ``length`` bytes."""
    payloads = list(dict.fromkeys(_payloads(length)))
    frames = [Frame(can_id, payload, flags) for payload in payloads]
    longest = max(frames, key=lambda frame: sum(frame_bits(frame)))
    return LongestFrame(most_frame_bits(longest), frame_bits(longest), longest)


def _payloads(length: int) -> Iterator[bytes]:
    """Patterns of runs, with endings drawn from a fixed seed, which change the CRC."""
    draw = random.Random(length)  # noqa: S311 - reproducible, not secret
    for pattern in _PATTERNS:
        payload = (pattern.to_bytes(2, "big") * (length // 2 + 1))[:length]
        yield payload
        for _ in range(_ENDINGS // len(_PATTERNS) if length else 0):
            yield payload[:-1] + draw.randbytes(1)
