"""Frames that a test has recorded, and what of them can be read."""

from pathlib import Path

import can

from steer_by_wire.runtime.frame import ERROR, EXTENDED, FD, REMOTE, Frame

FRAMES = (
    Frame(0x100, bytes(range(8))),
    Frame(0x7FF, b""),
    Frame(0x1ABCDEF0, b"\x01", EXTENDED),
    Frame(0x123, b"", REMOTE),
    Frame(0x124, bytes(range(12)), FD),
    Frame(0x040, bytes(8), ERROR),
)


def messages_in(path: Path) -> list[can.Message]:
    with can.LogReader(path) as reader:
        return list(reader)
