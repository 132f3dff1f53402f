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
