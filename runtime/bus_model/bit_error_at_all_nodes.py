"""What becomes of a frame when a bit is wrong, or the line is stuck, for all nodes alike.

Source: ISO 11898-1:2015, error detection and signalling. The sender compares each bit that it
sends with the bus, and signals an error from the next bit on: six dominant bits, or six recessive
ones if it is error passive. Receivers find the error in the disturbed bit itself or in the sender's
flag, at bit r, and add theirs. After the last flag follow eight recessive bits, the error
delimiter, so that the frame takes r + 15 bits. Three exceptions:

    identifier, RTR   a recessive bit seen dominant is arbitration lost: the sender falls silent,
                      all find a stuff error in the silence, and it is nobody's transmit error
    ACK slot          seen recessive: the sender misses the acknowledgement, and the receivers, who
                      send it, find a bit error
    stuff bit         a recessive one before RTR, seen dominant, is no transmit error
    last bit          seen dominant: the receivers have accepted the frame and take this for an
                      overload; the sender repeats it, and it is received twice

A receiver that reads a recessive res bit takes the frame for a later standard's: it neither signals
nor counts an error, and takes part again after eleven recessive bits. Receivers that signal an
error before others do see the others' flags after their own, and count 8 more.

Stuck line: a dominant level that stays after the flags counts 8 for everybody each 8 bits. The
sender goes into bus-off, receivers become error passive, and nothing can be sent until the line is
recessive for 11 bits. On a recessive line each start of frame is a bit error to its sender, which
goes into bus-off after 32 attempts, while receivers see an idle bus. The bit errors within its
flags, which bring that about sooner, are not counted.
"""

from functools import lru_cache
from typing import NamedTuple

from ..frame import FD, Frame
from ..frame.length_with_stuff_bits import INTERMISSION_BITS, FrameBits
from ..frame.received_bits import WireError, receive
from ..frame.wire_bits import DOMINANT, RECESSIVE, RUN_MAX, WireBit, frame_on_wire, stuffed_text

STUCK_DOMINANT, STUCK_RECESSIVE = "stuck dominant", "stuck recessive"
_AGAIN_BITS = 8
"""A dominant line counts again after so many bits."""
FLAG_BITS, DELIMITER_BITS = 6, 8
SILENT_BITS = 11 - INTERMISSION_BITS
"""After a later standard's format, before the intermission."""
ONE, FIRST = 1, 9
"""What an error adds to a receive counter, and to that of a receiver that signals it first."""
ARBITRATION = frozenset({"ID", "SRR", "IDE", "ID extension", "RTR", "RRS"})
AFTER_ACK = frozenset({"ACK delimiter", "EOF"})
"""Where a receiver that acknowledged the frame has counted it as received already."""
_BEFORE_RTR = frozenset({"ID", "ID extension"})
"""Where a recessive stuff bit comes before RTR: SRR and IDE are recessive there themselves."""
_TRAILER = ("CRC delimiter", "ACK", "ACK delimiter", "EOF")


class Counted(NamedTuple):
    """What is added to receive counters: the sender's, the odd receiver's, all other receivers'."""

    sender: int = 0
    odd: int = 0
    receivers: int = ONE


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
    ``counted``             by the receive counters
    ``is_acknowledged``     by the receivers, but for the odd one, before they found an error
    """

    bits: FrameBits
    is_received: bool
    is_transmit_error: bool
    cause: str
    field: str
    only_at: int | None = None
    is_repeated: bool = True
    again: int = 0
    counted: Counted = Counted()
    is_acknowledged: bool = False


def disturb(frame: Frame, index: int, *, is_passive: bool) -> Disturbed:
    """Return what becomes of ``frame`` when its bit ``index`` is wrong.

    ``is_passive``  the sender is error passive
    """
    if not is_passive and not frame.flags & FD:
        return _disturb_classic(frame, index)
    return disturb_bit_by_bit(frame, index, is_passive=is_passive)


@lru_cache(maxsize=1024)
def disturb_bit_by_bit(frame: Frame, index: int, *, is_passive: bool) -> Disturbed:
    """Return the same, found bit by bit as a receiver sees them."""
    bits = frame_on_wire(frame)
    bit = bits[index]
    seen = [one.level for one in bits[:index]] + [1 - bit.level]
    is_lost = bit.field in ARBITRATION and bit.level == RECESSIVE and not bit.is_stuff
    if is_passive and index == 0:  # nobody else has seen a frame begin
        alone = _outcome(0, 0, bit.field, is_lost=False, is_last=False)
        return alone._replace(counted=Counted(receivers=0))
    flag = RECESSIVE if is_passive or is_lost else DOMINANT
    found = index
    if bit.field != "ACK" and index < len(bits) - 1:
        reception = receive(seen + [flag] * (FLAG_BITS + len(bits)))
        if reception.error is WireError.PROTOCOL_EXCEPTION:
            return _silent(reception.bit, index, bit.field, is_lost=is_lost)
        found = max(reception.bit, index)
    fast = sum(one.is_fast for one in bits[: index + 1])
    # Receivers that have found nothing yet still sample at the data rate.
    fast += found - index if bit.is_fast else 0
    is_last = index == len(bits) - 1
    outcome = _outcome(found, fast, bit.field, is_lost=is_lost, is_last=is_last)
    return outcome._replace(is_transmit_error=not (is_lost or is_excused(bit)))


def _disturb_classic(frame: Frame, index: int) -> Disturbed:
    """Return the same for an error active sender of a classic frame, from runs of equal bits."""
    levels, stuff = stuffed_text(frame)
    if index >= len(levels):
        field = _TRAILER[min(index - len(levels), 3)]
        return _outcome(index, 0, field, is_lost=False, is_last=index == len(levels) + 9)
    field = _classic_fields(frame.flags, len(frame.data))[stuff.count("0", 0, index)]
    if stuff[index] == "1":
        # The field of a stuff bit is that of the bit before it.
        field = _classic_fields(frame.flags, len(frame.data))[stuff.count("0", 0, index) - 1]
        outcome = _outcome(index, 0, field, is_lost=False, is_last=False)
        is_counted = levels[index] == "0" or field not in _BEFORE_RTR
        return outcome if is_counted else outcome._replace(is_transmit_error=False)
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


def disturb_stuck(frame: Frame, level: int, first: int, stuck_bits: int) -> Disturbed | None:
    """Return what becomes of ``frame``; None if it has no bit of the other level there.

    ``first``       the first bit at which the line is stuck; below 0, since before the frame
    ``stuck_bits``  how long from then on
    """
    bits = frame_on_wire(frame)
    wrong = next((i for i in range(max(first, 0), len(bits)) if bits[i].level != level), None)
    if wrong is None or wrong >= first + stuck_bits:
        return None
    fast = sum(bit.is_fast for bit in bits[: wrong + 1])
    until = max(first + stuck_bits, wrong + 1 + FLAG_BITS) if level == DOMINANT else wrong + 7
    slow = until - fast + DELIMITER_BITS
    cause = STUCK_DOMINANT if level == DOMINANT else STUCK_RECESSIVE
    is_own = first >= 0 or level != DOMINANT
    again = max(0, until - wrong - 1 - FLAG_BITS) // _AGAIN_BITS if level == DOMINANT else 0
    field = bits[wrong].field
    is_unheard = level == RECESSIVE and wrong == 0
    counted = Counted(sender=0 if is_own else ONE, receivers=0 if is_unheard else ONE)
    stuck = Disturbed(
        FrameBits(slow, fast), False, is_own, cause, field, None, True, again, counted
    )
    return stuck._replace(is_acknowledged=field in AFTER_ACK)


def is_excused(bit: WireBit) -> bool:
    """Whether a sender that sees ``bit`` wrong counts no transmit error: it may have lost."""
    return bit.is_stuff and bit.level == RECESSIVE and bit.field in _BEFORE_RTR


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
    counted = Counted(sender=ONE if is_lost else 0, receivers=0 if is_last else ONE)
    outcome = Disturbed(length, is_last, not is_lost, cause, field, counted=counted)
    return outcome._replace(is_acknowledged=field in AFTER_ACK)


def _silent(found: int, index: int, field: str, *, is_lost: bool) -> Disturbed:
    """The receivers take the frame for a later standard's at bit ``found``."""
    cause, last = ("arbitration lost", found) if is_lost else ("bit error", index)
    after = SILENT_BITS if is_lost else FLAG_BITS + DELIMITER_BITS
    length = FrameBits(last + 1 + after, 0)
    return Disturbed(length, False, not is_lost, cause, field, counted=Counted(receivers=0))
