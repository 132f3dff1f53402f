"""Long J1939 messages: their broadcast in frames of 8 bytes, which follow each other slowly.

    TP.CM_BAM  0xEC00  0x20, bytes (2), packets, 0xFF, parameter group (3)
    TP.DT      0xEB00  number of the packet, from 1, and seven bytes; the last is filled with 0xFF

Both go to all from the source address of the message, with priority 7, numbers little-endian. 50
to 200 ms pass between two of them, and a source sends one message at a time.

Source: SAE J1939-21, transport protocol, broadcast announce message (BAM).
"""

from collections.abc import Iterable

from ..runtime.frame import EXTENDED, Frame

LENGTH_MAX = 1785
"""255 packets of seven bytes."""
GAP_NS = 50_000_000
"""Least time between two frames of a source."""
_ANNOUNCEMENT, _DATA = 0x1CECFF00, 0x1CEBFF00
_TO_ONE_MAX = 239
"""Up to this PDU format the byte after it is a destination, and not part of the group."""
_PACKET_BYTES = 7


def source_address(can_id: int) -> int:
    """Return the node that an identifier of J1939 names."""
    return can_id & 0xFF


def announcement_id(source: int) -> int:
    """Return the identifier of TP.CM from a source address."""
    return _ANNOUNCEMENT | source


def data_id(source: int) -> int:
    """Return the identifier of TP.DT from a source address."""
    return _DATA | source


def packets(length: int) -> int:
    """Return how many frames of TP.DT carry so many bytes."""
    return -(-length // _PACKET_BYTES)


def announcement_gap_ns(payload_lengths: Iterable[int]) -> int:
    """Return the least time between two announcements of a source that sends such messages [ns]."""
    return (1 + min(map(packets, payload_lengths))) * GAP_NS


def segments(can_id: int, payload: bytes) -> tuple[Frame, ...]:
    """Return the frames of a message: its announcement, and its packets in order."""
    source, group = source_address(can_id), can_id >> 8 & 0x3FFFF
    if group >> 8 & 0xFF <= _TO_ONE_MAX:
        group &= ~0xFF
    count = packets(len(payload))
    announcement = b"\x20%b%c\xff%b" % (
        len(payload).to_bytes(2, "little"), count, group.to_bytes(3, "little")
    )  # fmt: skip
    filled = payload.ljust(count * _PACKET_BYTES, b"\xff")
    data = (
        bytes([number + 1]) + filled[number * _PACKET_BYTES :][:_PACKET_BYTES]
        for number in range(count)
    )
    return (
        Frame(announcement_id(source), announcement, EXTENDED),
        *(Frame(data_id(source), one, EXTENDED) for one in data),
    )
