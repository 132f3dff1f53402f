"""Frames that a test has recorded, and what of them can be read."""

from pathlib import Path

import can

from steer_by_wire.closed_loop.recordings.candump_text import CandumpReader
from steer_by_wire.closed_loop.recordings.logged import Logged
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


def entries_in(log: Path) -> list[Logged]:
    """Every frame of a candump log, in which every line is one but a torn last one."""
    whole, _, _torn = log.read_text(encoding="ascii").rpartition("\n")
    entries = [(line, CandumpReader()(line)) for line in whole.splitlines()]
    assert [line for line, entry in entries if entry is None] == []
    return [entry for _, entry in entries if entry is not None]
