"""Arbitration: the bits by which one of several frames wins the bus."""

from .frame import EXTENDED, REMOTE, Frame


def arbitration_field(frame: Frame) -> int:
    """The bits that compete for the bus, as a number of 32 bits; the lower one wins.

    Base identifier (11), RTR or SRR, IDE, identifier extension (18), RTR: an 11-bit identifier wins
    against a 29-bit one with the same base, a data frame against a remote frame of its identifier.
    """
    can_id, _, flags = frame
    if not flags:
        return can_id << 21
    rtr = 1 if flags & REMOTE else 0
    if flags & EXTENDED:
        return can_id >> 18 << 21 | 0b11 << 19 | (can_id & 0x3FFFF) << 1 | rtr
    return can_id << 21 | rtr << 20
