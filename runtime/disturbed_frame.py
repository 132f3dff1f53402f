"""What becomes of a frame when one of its bits is wrong on the wire, for all nodes alike.

Source: ISO 11898-1:2015, error detection and signalling. The sender compares each bit that it
sends with the bus, and signals an error from the next bit on: six dominant bits, or six recessive
ones if it is error passive. Receivers find the error in the disturbed bit itself or in the sender's
flag, at bit r, and add theirs. After the last flag follow eight recessive bits, the error
delimiter, so that the frame takes r + 15 bits. Three exceptions:

    identifier, RTR   a recessive bit seen dominant is arbitration lost: the sender falls silent,
                      all find a stuff error in the silence, and it is nobody's transmit error
    ACK slot          seen recessive: the sender misses the acknowledgement, and the receivers, who
                      send it, find a bit error
    last bit          seen dominant: the receivers have accepted the frame and take this for an
                      overload; the sender repeats it, and it is received twice
"""

from functools import lru_cache
from typing import NamedTuple

from .frame import FD, Frame
from .frame_length import FrameBits
from .frame_on_wire import DOMINANT, RECESSIVE, RUN_MAX, frame_on_wire
from .frame_reception import receive
from .stuffed_text import stuffed_text

FLAG_BITS, DELIMITER_BITS = 6, 8
ARBITRATION = frozenset({"ID", "SRR", "IDE", "ID extension", "RTR", "RRS"})
_TRAILER = ("CRC delimiter", "ACK", "ACK delimiter", "EOF")


class Disturbed(NamedTuple):
    """One transmission with a wrong bit.

    ``bits``                start of frame to the end of the error delimiter
    ``is_received``         the receivers have accepted the frame all the same
    ``is_transmit_error``   the sender counts it as an error of its own
    ``cause``               what the sender saw
    ``field``               where
    ``only_at``             the one receiver that does not accept the frame, where others do
    ``is_repeated``         the sender sends it again
    ``again``               how often everybody counts 8 for a line that stays dominant
    """

    bits: FrameBits
    is_received: bool
    is_transmit_error: bool
    cause: str
    field: str
    only_at: int | None = None
    is_repeated: bool = True
    again: int = 0


def disturb(frame: Frame, index: int, *, is_passive: bool) -> Disturbed:
    """Return what becomes of ``frame`` when its bit ``index`` is wrong.

    ``is_passive``  the sender is error passive
    """
    if not is_passive and not frame.flags & FD:
        return _disturb_classic(frame, index)
    return disturb_bit_by_bit(frame, index, is_passive=is_passive)


@lru_cache(maxsize=1024)
def disturb_bit_by_bit(frame: Frame, index: int, *, is_passive: bool) -> Disturbed:
    """Return the same from every bit that a receiver sees."""
    bits = frame_on_wire(frame)
    bit = bits[index]
    seen = [one.level for one in bits[:index]] + [1 - bit.level]
    is_lost = bit.field in ARBITRATION and bit.level == RECESSIVE and not bit.is_stuff
    flag = RECESSIVE if is_passive or is_lost else DOMINANT
    found = index
    if bit.field != "ACK" and index < len(bits) - 1:
        found = max(receive(seen + [flag] * (FLAG_BITS + len(bits))).bit, index)
    fast = sum(one.is_fast for one in bits[: index + 1])
    # Receivers that have found nothing yet still sample at the data rate.
    fast += found - index if bit.is_fast else 0
    is_last = index == len(bits) - 1
    return _outcome(found, fast, bit.field, is_lost=is_lost, is_last=is_last)


def _disturb_classic(frame: Frame, index: int) -> Disturbed:
    """Return it for an error active sender of a classic frame, from runs of equal bits."""
    levels, stuff = stuffed_text(frame)
    if index >= len(levels):
        field = _TRAILER[min(index - len(levels), 3)]
        return _outcome(index, 0, field, is_lost=False, is_last=index == len(levels) + 9)
    field = _classic_fields(frame.flags, len(frame.data))[stuff.count("0", 0, index)]
    if stuff[index] == "1":
        # The field of a stuff bit is that of the bit before it.
        field = _classic_fields(frame.flags, len(frame.data))[stuff.count("0", 0, index) - 1]
        return _outcome(index, 0, field, is_lost=False, is_last=False)
    before, left = levels[:index], stuff.count("0", index + 1)
    if levels[index] == "1":
        if field in ARBITRATION and frame.flags:  # silence may look like a later standard's frame
            return disturb_bit_by_bit(frame, index, is_passive=False)
        if field in ARBITRATION:
            return _outcome(index + 6, 0, field, is_lost=True, is_last=False)
        zeros = index - len(before.rstrip("0")) + 1
        found = min(index + 6 - zeros, index + left + 1)
    else:
        ones = index - len(before.rstrip("1")) + 1
        # A fifth recessive bit makes the flag's first bit a stuff bit.
        found = min(index + 6, index + left + 1 + (ones == RUN_MAX))
    return _outcome(found, 0, field, is_lost=False, is_last=False)


@lru_cache(maxsize=64)
def _classic_fields(flags: int, length: int) -> tuple[str, ...]:
    """Field of each bit without stuff bits, up to the end of the CRC."""
    bits = frame_on_wire(Frame(0, bytes(length), flags))
    return tuple(bit.field for bit in bits if not bit.is_stuff)


def _outcome(found: int, fast: int, field: str, *, is_lost: bool, is_last: bool) -> Disturbed:
    """Receivers find the error at bit ``found``; ``fast`` bits until then are data bits."""
    cause = "arbitration lost" if is_lost else "bit error"
    if field == "ACK":
        cause = "no acknowledgement"
    length = FrameBits(found + 1 - fast + FLAG_BITS + DELIMITER_BITS, fast)
    return Disturbed(length, is_last, not is_lost, cause, field)
