"""What becomes of a frame on a line that is stuck at one level.

Source: ISO 11898-1:2015, fault confinement. A dominant level that stays after the flags counts 8
for everybody each 8 bits: the sender goes into bus-off, receivers become error passive. Nothing can
be sent until the line is recessive for 11 bits. On a recessive line each start of frame is a bit
error to its sender, so that whoever sends goes into bus-off after 32 attempts. The bit errors
within its flags, which bring that about sooner, are not counted.
"""

from ..frame import Frame
from ..frame.bits import DOMINANT, frame_on_wire
from ..frame.length import FrameBits
from .disturbed_frame import DELIMITER_BITS, FLAG_BITS, ONE, Counted, Disturbed

STUCK_DOMINANT, STUCK_RECESSIVE = "stuck dominant", "stuck recessive"
_AGAIN_BITS = 8
"""A dominant line counts again after so many bits."""


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
    counted = Counted(sender=0 if is_own else ONE)
    return Disturbed(FrameBits(slow, fast), False, is_own, cause, field, None, True, again, counted)
