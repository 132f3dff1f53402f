"""Frames on the serial lines of a User Mode Linux, both ways: kind, length, content."""

import struct
from collections.abc import Iterator
from enum import IntEnum
from typing import NamedTuple

_HEAD = struct.Struct("<BI")


class Kind(IntEnum):
    """The kinds of frames; the first three are the numbers of the streams that they carry."""

    STDIN = 0
    STDOUT = 1
    STDERR = 2
    READY = 3
    """The interfaces are up and the command starts; from now on the guest reads frames."""
    FAILED = 4
    """There will be no command; content: why."""
    STATUS = 5
    """The command has ended; content: its exit status, decimal."""
    SIGNAL = 6
    """To be sent to the command; content: its number, decimal."""
    CLOSED = 7
    """Nobody reads this stream of the command any more; content: its number, decimal."""
    SIZE = 8
    """Of the terminal, if the command has one; content: struct winsize."""


class LineFrame(NamedTuple):
    """One frame; a stream's frame without content is its end."""

    kind: Kind
    content: bytes


def pack(kind: Kind, content: bytes = b"") -> bytes:
    """Return a frame as bytes."""
    return _HEAD.pack(kind, len(content)) + content


class Unpacker:
    """Reassembles frames from pieces of any size."""

    def __init__(self) -> None:
        self._waiting = b""

    def feed(self, piece: bytes) -> Iterator[LineFrame]:
        """Return the frames that ``piece`` completes."""
        self._waiting += piece
        while len(self._waiting) >= _HEAD.size:
            kind, length = _HEAD.unpack_from(self._waiting)
            end = _HEAD.size + length
            if len(self._waiting) < end:
                return
            content, self._waiting = self._waiting[_HEAD.size : end], self._waiting[end:]
            yield LineFrame(Kind(kind), content)
