"""What becomes of a frame when one of its bits is wrong on the wire, for all nodes alike.

Source: ISO 11898-1:2015, error detection and signalling. The sender compares each bit that it
sends with the bus, and signals an error from the next bit on: six dominant bits, or six recessive
ones if it is error passive. Receivers find the error in the disturbed bit itself or in the sender's
flag, at bit r, and add theirs. After the last flag follow eight recessive bits, the error
delimiter, so that the frame takes r + 15 bits. Three exceptions:

    identifier, RTR   a recessive bit seen dominant is arbitration lost: the sender falls silent,
                      all find a stuff error in the silence, and it is nobody's transmit error
    ACK slot          seen recessive: the sender misses the acknowledgement
    last bit          seen dominant: the receivers have accepted the frame and take this for an
                      overload; the sender repeats it, and it is received twice
"""

from functools import lru_cache
from typing import NamedTuple

from .frame import Frame
from .frame_length import FrameBits
from .frame_on_wire import DOMINANT, RECESSIVE, WireBit, frame_on_wire
from .frame_reception import receive

_FLAG_BITS, _DELIMITER_BITS = 6, 8
_ARBITRATION = frozenset({"ID", "SRR", "IDE", "ID extension", "RTR", "RRS"})


class Disturbed(NamedTuple):
    """One transmission with a wrong bit.

    ``bits``                start of frame to the end of the error delimiter
    ``is_received``         the receivers have accepted the frame all the same
    ``is_transmit_error``   the sender counts it as an error of its own
    ``cause``               what the sender saw
    ``field``               where
    """

    bits: FrameBits
    is_received: bool
    is_transmit_error: bool
    cause: str
    field: str


@lru_cache(maxsize=1024)
def disturb(frame: Frame, index: int, *, is_passive: bool) -> Disturbed:
    """Return what becomes of ``frame`` when its bit ``index`` is wrong.

    ``is_passive``  the sender is error passive
    """
    bits = frame_on_wire(frame)
    bit = bits[index]
    seen = [one.level for one in bits[:index]] + [1 - bit.level]
    is_lost = bit.field in _ARBITRATION and bit.level == RECESSIVE and not bit.is_stuff
    flag = RECESSIVE if is_passive or is_lost else DOMINANT
    reception = receive(seen + [flag] * (_FLAG_BITS + len(bits)))
    is_received = index == len(bits) - 1
    found = index if is_received else max(reception.bit, index)
    cause = "arbitration lost" if is_lost else "bit error"
    if bit.field == "ACK":
        cause = "no acknowledgement"
    return Disturbed(_duration(bits, index, found), is_received, not is_lost, cause, bit.field)


def _duration(bits: tuple[WireBit, ...], index: int, found: int) -> FrameBits:
    """Bits from start of frame to the end of the error delimiter, flags at the nominal rate."""
    fast = sum(bit.is_fast for bit in bits[: index + 1])
    waited = found - index
    # Receivers that have found nothing yet still sample at the data rate.
    fast += waited if bits[index].is_fast else 0
    return FrameBits(found + 1 - fast + _FLAG_BITS + _DELIMITER_BITS, fast)
