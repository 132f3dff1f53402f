"""The record of the lockstep protocol as bytes; ``lockstep.h`` describes it for C."""

import struct
from collections.abc import Sequence
from typing import NamedTuple

from ...runtime.frame import BITRATE_SWITCH, EXTENDED, FD, REMOTE, Frame
from ...runtime.frame.length_with_stuff_bits import frame_bits

MARK = b"LSP1"
FRAMES_MAX = 16
START, DEADLINE, FRAMES = 1, 2, 4
"""Why the controller is woken."""
WAKE_ON_FRAMES = 1
"""Flag of an answer: wake me for every frame, not only at my deadline."""

_HEAD = struct.Struct("<4sHHq")
_FRAME = struct.Struct("<qIBB2x64s")
FRAME_BYTES = _FRAME.size
RECORD_BYTES = _HEAD.size + FRAMES_MAX * FRAME_BYTES
_PADDING = tuple(bytes(count * FRAME_BYTES) for count in range(FRAMES_MAX, -1, -1))
"""Bytes after a number of frames."""
_CLASSIC_BYTES_MAX, _BASE_ID_MAX = 8, 0x7FF
_FORMATS = EXTENDED | REMOTE | FD | BITRATE_SWITCH

Arrival = tuple[int, Frame]
"""When a frame arrived [ns], and the frame."""


class RecordError(ValueError):
    """Bytes that are no record of this protocol; the text says what is wrong with them."""


class Record(NamedTuple):
    """One record in either direction.

    ``flags``    START, DEADLINE or FRAMES to the controller; WAKE_ON_FRAMES or 0 from it
    ``time_ns``  now, to the controller; its next deadline, from it
    ``frames``   up to FRAMES_MAX
    """

    flags: int
    time_ns: int
    frames: Sequence[Arrival] = ()


def pack(record: Record) -> bytes:
    """Return the RECORD_BYTES bytes of a record."""
    frames = record.frames
    head = _HEAD.pack(MARK, record.flags, len(frames), record.time_ns)
    parts = [
        _FRAME.pack(time_ns, can_id, len(data), flags, data)
        for time_ns, (can_id, data, flags) in frames
    ]
    return b"".join((head, *parts, _PADDING[len(frames)]))


def check_mark(beginning: bytes) -> None:
    """Raise RecordError for bytes with which no record begins."""
    if not MARK.startswith(beginning[: len(MARK)]):
        raise RecordError(f"a record begins with {MARK!r}, this with {beginning[:40]!r}")


def unpack(record: bytes) -> Record:
    """Return the record in RECORD_BYTES bytes; raises RecordError."""
    check_mark(record)
    _, flags, count, time_ns = _HEAD.unpack_from(record)
    if count > FRAMES_MAX:
        raise RecordError(f"{count} frames in one record (allowed: 0 to {FRAMES_MAX})")
    return Record(flags, time_ns, [_arrival(record, index) for index in range(count)])


def _arrival(record: bytes, index: int) -> Arrival:
    offset = _HEAD.size + index * FRAME_BYTES
    time_ns, can_id, length, flags, data = _FRAME.unpack_from(record, offset)
    frame = Frame(can_id, data[:length], flags)
    if not flags and length <= _CLASSIC_BYTES_MAX and can_id <= _BASE_ID_MAX:
        return time_ns, frame
    if flags & ~_FORMATS:
        raise RecordError(f"frame {index} of {can_id:#x}: there is no format {flags}")
    if length > len(data):
        raise RecordError(f"frame {index} of {can_id:#x}: {length} bytes of data (at most 64)")
    try:
        frame_bits(frame)
    except ValueError as error:
        raise RecordError(f"frame {index} of {can_id:#x}: {error}") from error
    return time_ns, frame
