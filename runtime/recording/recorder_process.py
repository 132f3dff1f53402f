"""The recorder: writes records from a pipe to a file with python-can's writers.

A frame that waited before the program read it can be older than frames recorded already. The
writers would give it the time of the frame before it, so records are sorted first: each is held
until one comes that is HELD_NS newer, or none has come for IDLE_S.

Text is flushed after every read, so that it is in the file even if the recorder is killed. It may
then end in the middle of a line, which readers must not take for a frame.
"""

import json
import os
import select
import signal
import sys
from bisect import bisect_right
from collections.abc import Iterator
from operator import itemgetter
from pathlib import Path
from typing import Any

import can
from can.io.generic import MessageWriter, TextIOMessageWriter

from ..exit_status import cause_of
from ..frame import Frame
from ..frame.message import message_of
from .recorder import RECORD

HELD_NS = 100_000_000
"""Longer than frames wait in a program that is on time."""
IDLE_S = 0.2
"""Held records are written when nothing has come for this long."""
_READ_BYTES = 1 << 16


_Record = tuple[int, Frame, bool]
"""Time [ns], frame, and whether it was received."""
_time_ns_of = itemgetter(0)


def record(path: Path, channel: str, source: int) -> dict[str, Any]:
    """Write every record from the descriptor ``source`` to ``path``, up to a failure.

    Returns frames and failure. After a failure, frames are those of text that has been
    flushed; what a binary format then holds is not known.

    Prints "ready" on standard output when the file is open.
    """
    count = flushed = 0
    failure = ""
    writer: MessageWriter | None = None
    try:
        writer = can.Logger(path)
        os.write(1, b"ready\n")
        for records in _ordered(_records(source)):
            for time_ns, frame, is_received in records:
                message = message_of(frame)
                message.timestamp = time_ns * 1e-9
                message.channel = channel
                message.is_rx = is_received
                writer.on_message_received(message)
                count += 1
            if isinstance(writer, TextIOMessageWriter):
                writer.file.flush()
                flushed = count
    except Exception as error:  # a writer may raise anything
        failure = cause_of(error)
    try:
        if writer is not None:
            writer.stop()
    except Exception as error:
        failure = failure or cause_of(error)
    return {"frames": flushed if failure else count, "failure": failure}


def _ordered(reads: Iterator[list[_Record]]) -> Iterator[list[_Record]]:
    """Yield the records in order of time, as far as HELD_NS goes.

    A read without records is a pause: all held records are yielded.
    """
    held: list[_Record] = []
    newest_ns = 0
    for records in reads:
        held = sorted(held + records, key=_time_ns_of)
        ripe = len(held)
        if records:
            newest_ns = max(newest_ns, held[-1][0])
            ripe = bisect_right(held, newest_ns - HELD_NS, key=_time_ns_of)
        yield held[:ripe]
        held = held[ripe:]
    yield held


def _records(source: int) -> Iterator[list[_Record]]:
    """Yield the complete records of each read until the pipe ends; an empty list for a pause."""
    rest = b""
    while True:
        if not select.select([source], (), (), IDLE_S)[0]:
            yield []
            continue
        part = os.read(source, _READ_BYTES)
        if not part:
            return
        rest += part
        records, place = [], 0
        while len(rest) - place >= RECORD.size:
            time_ns, can_id, flags, is_received, length = RECORD.unpack_from(rest, place)
            data = rest[place + RECORD.size : place + RECORD.size + length]
            if len(data) < length:
                break
            records.append((time_ns, Frame(can_id, data, flags), is_received))
            place += RECORD.size + length
        rest = rest[place:]
        if records:
            yield records


if __name__ == "__main__":
    # The terminal's Ctrl-C ends the program, and the end of the pipe then ends the recorder.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _, _path, _channel = sys.argv
    os.write(1, json.dumps(record(Path(_path), _channel, 0)).encode("ascii"))
