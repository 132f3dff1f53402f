"""One CAN frame: as the nodes see it, and its length on the wire.

Not here: who may send when (``bus_model``), and how a program gets at a bus (``port``).
Begin at ``frame.py``, whose names this package hands on.
"""

from .frame import (
    BITRATE_SWITCH,
    CLASSIC_LENGTH_MAX,
    ERROR,
    EXTENDED,
    FD,
    REMOTE,
    Frame,
)

__all__ = [
    "BITRATE_SWITCH",
    "CLASSIC_LENGTH_MAX",
    "ERROR",
    "EXTENDED",
    "FD",
    "REMOTE",
    "Frame",
]
