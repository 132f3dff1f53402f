"""The binary form in which rows go to a page: little-endian, a batch for each lane in one message.

header   kind (1) u8, lane u8, columns u16, rows u32
row      time [s] f64, columns f32
"""

import struct
from collections.abc import Sequence

from .signals import NAMES

_HEADER = struct.Struct("<BBHI")
_ROW = struct.Struct(f"<d{len(NAMES)}f")
_ROWS = 1


def packed_row(time_s: float, values: Sequence[float]) -> bytes:
    """Return one row."""
    return _ROW.pack(time_s, *values)


def packed_rows(lane: int, rows: Sequence[bytes]) -> bytes:
    """Return a batch of packed rows of one lane."""
    return _HEADER.pack(_ROWS, lane, len(NAMES), len(rows)) + b"".join(rows)
