"""What a receiver at another bit rate reads: sample points, synchronised at edges.

Source: ISO 11898-1:2015, bit timing. A receiver synchronises hard at the start of frame, and at
each edge from recessive to dominant by at most its synchronisation jump width. In between it counts
bits by its own clock and reads the wire at its sample point. Nodes whose rates differ by more than
that can follow read other bits, and find errors in nearly every frame.
"""

from collections.abc import Iterator
from typing import NamedTuple

from ..frame import Frame
from ..frame.bits import DOMINANT, RECESSIVE, frame_on_wire
from ..frame.reception import Reception, receive
from ..node import NEVER_NS


class BitTiming(NamedTuple):
    """Of one node, as shares of its bit time.

    ``sample_point``  when it reads a bit
    ``jump_width``    how far it moves a bit's start at an edge, at most
    """

    sample_point: float = 0.8
    jump_width: float = 0.2


def received_at(frame: Frame, ratio: float, timing: BitTiming) -> Reception:
    """Return what a receiver makes of a classic frame.

    ``ratio``  its bit time, as a share of the sender's
    """
    return receive(_sampled([bit.level for bit in frame_on_wire(frame)], ratio, timing))


def _sampled(levels: list[int], ratio: float, timing: BitTiming) -> Iterator[int]:
    """The levels at the receiver's sample points; times are in bits of the sender."""
    edges = [
        index
        for index in range(1, len(levels))
        if levels[index - 1] == RECESSIVE and levels[index] == DOMINANT
    ]
    start = 0.0
    while start < len(levels) + 12:
        end = start + ratio
        for edge in edges:
            # An edge after the sample point lengthens nothing: the next bit starts with it.
            if start < edge < end:
                late = edge - start if edge - start < ratio * timing.sample_point else edge - end
                jump = max(-timing.jump_width * ratio, min(timing.jump_width * ratio, late))
                start, end = (start + jump, end + jump) if late > 0 else (start, end + jump)
                break
        at = int(start + timing.sample_point * ratio)
        yield levels[at] if at < len(levels) else RECESSIVE
        start = end


class WrongRate:
    """Noise of a node whose rate is wrong: it reads every frame wrong, and is read wrong.

    ``bit_ns``  of the bus [ns]

    The error is placed in the tenth bit, where a stuff error has been found at the latest.
    """

    def __init__(self, bit_ns: int) -> None:
        self._offset_ns = 9 * bit_ns + bit_ns // 2

    def first_hit_ns(self, start_ns: int, end_ns: int) -> int | None:
        """Return an instant within a frame that starts at ``start_ns`` [ns]."""
        hit_ns = start_ns + self._offset_ns
        return start_ns if end_ns == NEVER_NS else hit_ns
