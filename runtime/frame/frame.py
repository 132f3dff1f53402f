"""A CAN frame as the nodes see it: identifier, payload, format. It carries no time.

Times are arguments (``now_ns``) everywhere, so that the same frame means the same on a real bus,
on the emulated bus and in virtual time.
"""

from typing import NamedTuple

EXTENDED = 1
"""29-bit identifier."""
REMOTE = 2
"""Remote transmission request: a frame without a payload."""
ERROR = 4
"""Error frame made by the local controller (SocketCAN convention); never sent by a node."""
FD = 8
"""CAN FD frame (ISO 11898-1:2015)."""
BITRATE_SWITCH = 16
"""CAN FD frame whose data phase runs at the data bit rate."""
CLASSIC_LENGTH_MAX = 8
"""Longest payload of a frame without FD [bytes]."""


class Frame(NamedTuple):
    """One CAN frame.

    ``can_id``  identifier without format bits, 0 to 0x7FF (or 0x1FFFFFFF with EXTENDED)
    ``data``    payload, 0 to 8 bytes (up to 64 with FD)
    ``flags``   sum of EXTENDED, REMOTE, ERROR, FD, BITRATE_SWITCH
    """

    can_id: int
    data: bytes
    flags: int = 0


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
