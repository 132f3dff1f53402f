"""What becomes of a frame when one node alone sees one of its bits wrong.

Source: ISO 11898-1:2015, error detection and signalling. An error active node that finds an error
destroys the frame for all with its flag. An error passive one cannot: it alone misses the frame.
Three cases matter to an actuator:

    last bit but one of the end of frame   one receiver rejects the frame, the others have accepted
                                           it; the sender repeats it, and they receive it twice. If
                                           it cannot, in bus-off, that one receiver never gets it
    last bit, at the sender                all have accepted the frame, and it is repeated
    r0 of eight bytes, at one receiver     it reads FDF and a recessive res bit, a later standard's
                                           format: without any error, it alone misses the frame
"""

from functools import lru_cache

from ..frame import Frame
from ..frame.length_with_stuff_bits import FrameBits
from ..frame.received_bits import WireError, receive
from ..frame.wire_bits import DOMINANT, RECESSIVE, WireBit, frame_on_wire
from .bit_error_at_all_nodes import (
    AFTER_ACK,
    ARBITRATION,
    DELIMITER_BITS,
    FIRST,
    FLAG_BITS,
    ONE,
    SILENT_BITS,
    Counted,
    Disturbed,
    is_excused,
)


@lru_cache(maxsize=1024)
def disturb_receiver(frame: Frame, index: int, node: int, *, is_passive: bool) -> Disturbed | None:
    """Return what follows if receiver ``node`` sees bit ``index`` wrong; None if nothing does.

    ``is_passive``  that receiver is error passive
    """
    bits = frame_on_wire(frame)
    levels = [bit.level for bit in bits]
    view = [*levels[:index], 1 - levels[index], *levels[index + 1 :]]
    start = view.index(DOMINANT)
    reception = receive(view[start:])
    is_silent = reception.error is WireError.PROTOCOL_EXCEPTION
    found = min(start + reception.bit, len(bits) - 2)
    if bits[index].field == "ACK":
        found = index  # a bit error to the receiver, who sends it
    elif reception.frame == frame:
        return None
    if is_passive or is_silent:
        return Disturbed(
            _length(bits, len(bits) - 1),
            is_received=True,
            is_transmit_error=False,
            cause="missed by one receiver",
            field=bits[index].field,
            only_at=node,
            is_repeated=False,
            counted=Counted(odd=0 if is_silent else ONE, receivers=0),
        )
    is_received = found == len(bits) - 2
    flagged = levels[: found + 1] + [DOMINANT] * (FLAG_BITS + len(bits))
    others = found + 1 if is_received else receive(flagged).bit
    own = next(i for i in range(found + 1, len(bits)) if levels[i] == RECESSIVE)
    is_lost = bits[own].field in ARBITRATION and not bits[own].is_stuff
    last = max(others, others if is_lost else own)
    return Disturbed(
        _length(bits, last, FLAG_BITS + DELIMITER_BITS),
        is_received=is_received,
        is_transmit_error=not (is_lost or is_excused(bits[own])),
        cause="error at one receiver",
        field=bits[index].field,
        only_at=node,
        counted=Counted(ONE if is_lost else 0, FIRST, 0 if is_received else ONE),
        is_acknowledged=bits[others].field in AFTER_ACK,
    )


@lru_cache(maxsize=1024)
def disturb_sender(frame: Frame, index: int, *, is_passive: bool) -> Disturbed:
    """Return what follows if the sender alone sees bit ``index`` wrong."""
    bits = frame_on_wire(frame)
    levels = [bit.level for bit in bits]
    bit = bits[index]
    if bit.field in ARBITRATION and bit.level == RECESSIVE and not bit.is_stuff:
        return _lost_at_sender(bits, index, is_passive=is_passive)
    flag = RECESSIVE if is_passive else DOMINANT
    reception = receive(levels[: index + 1] + [flag] * (FLAG_BITS + len(bits)))
    is_received = reception.error is None or index == len(bits) - 1
    is_silent = reception.error is WireError.PROTOCOL_EXCEPTION
    if is_passive and is_received:
        # Nobody hears its flag, which the acknowledgement of the others may still interrupt.
        found = max(index, next(i for i, one in enumerate(bits) if one.field == "ACK"))
    else:
        # Receivers take a flag after the frame for an overload, and answer it.
        found = index + 1 if is_received else index if is_silent else max(index, reception.bit)
    is_unheard = is_passive and bit.field == "ACK"
    is_form_error = reception.error is WireError.FORM  # who finds a CRC error does not acknowledge
    return Disturbed(
        _length(bits, found, FLAG_BITS + DELIMITER_BITS),
        is_received=is_received,
        is_transmit_error=not (is_unheard or is_excused(bit)),
        cause="no acknowledgement" if bit.field == "ACK" else "bit error",
        field=bit.field,
        counted=Counted(receivers=0 if is_received or is_silent else ONE),
        is_acknowledged=is_form_error and bits[reception.bit].field in AFTER_ACK,
    )


def _lost_at_sender(bits: tuple[WireBit, ...], index: int, *, is_passive: bool) -> Disturbed:
    """The sender falls silent; it and the receivers read the silence by different bits."""
    before = [bit.level for bit in bits[:index]]
    views = [[*before, DOMINANT], [*before, RECESSIVE]]  # the sender's, the receivers'
    silence = [RECESSIVE] * len(bits)
    read = [receive(view + silence) for view in views]
    heard = read[1:] if is_passive else read
    signalled = [one.bit for one in heard if one.error is not WireError.PROTOCOL_EXCEPTION]
    counted, last, after = [0, 0], max(one.bit for one in read), SILENT_BITS
    if signalled:
        flagged = [RECESSIVE] * (min(signalled) - index) + [DOMINANT] * len(bits)
        read = [receive(view + flagged) for view in views]
        found = [0 if one.error is WireError.PROTOCOL_EXCEPTION else one.bit for one in read]
        last, after = max(found), FLAG_BITS + DELIMITER_BITS
        counted = [0 if at == 0 else ONE if at == last or is_passive else FIRST for at in found]
    return Disturbed(
        _length(bits, last, after),
        is_received=False,
        is_transmit_error=False,
        cause="arbitration lost",
        field=bits[index].field,
        counted=Counted(sender=counted[0], receivers=counted[1]),
    )


def unacknowledged(frame: Frame, *, is_passive: bool) -> Disturbed:
    """Return what follows if nobody is there to acknowledge: an error of an active sender alone."""
    bits = frame_on_wire(frame)
    index = next(i for i, bit in enumerate(bits) if bit.field == "ACK")
    return Disturbed(
        _length(bits, index, FLAG_BITS + DELIMITER_BITS),
        is_received=False,
        is_transmit_error=not is_passive,
        cause="no acknowledgement",
        field="ACK",
        counted=Counted(receivers=0),
    )


def _length(bits: tuple[WireBit, ...], last: int, after: int = 0) -> FrameBits:
    """Bits up to ``last`` by their rate, and nominal ones after them."""
    upto = bits[: last + 1]
    fast = sum(bit.is_fast for bit in upto)
    return FrameBits(last + 1 - fast + after, fast)
