"""The recorder: writes records from a pipe to a file with python-can's writers.

A frame that waited before the program took it can be older than frames recorded already. The
writers would give it the time of the frame before it, so records are sorted first: each is held
until one comes that is HELD_NS newer, or none has come for IDLE_S.

Text formats and ``.blf`` lose at most the last second, whatever is killed: text is flushed after
every read, ``.blf`` every SYNC_NS, and both are then synced to the disk. A text file may then end
in the middle of a line, which readers must not take for a frame.

Whenever the number of frames in the file changes, it is written to a separate file of the program,
so that it is known even if the recorder is killed.
"""

import argparse
import errno
import heapq
import json
import os
import select
import signal
import sys
import time
from collections.abc import Callable, Iterator
from io import FileIO
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import can
from can.io.generic import MessageWriter, TextIOMessageWriter

from ..exit_status import cause_of
from ..frame import Frame
from ..frame.message import message_of
from ..node import NS_PER_S
from .recording import LEFT_OUT, PROGRESS, RECORD

HELD_NS = 100_000_000
"""Longer than frames wait in a program that is on time."""
IDLE_S = 0.2
"""Held records are written when nothing has come for this long. On Windows, where select takes no
pipes, they are held until the next frame."""
SYNC_NS = NS_PER_S // 2
"""HELD_NS, IDLE_S, this and the time of a disk add up to less than a second."""
_READ_BYTES = 1 << 16
_POLL_S, _SETTLE_S = 0.02, 5.0


def main() -> int:
    """Record frames from standard input until it ends; report the result to the program."""
    # The terminal's Ctrl-C ends the program, and the end of the pipe then ends the recorder.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parser = argparse.ArgumentParser(
        prog="python -m steer_by_wire.runtime.recording.recorder_process"
    )
    parser.add_argument("path", type=Path)
    parser.add_argument("channel")
    parser.add_argument("progress", type=int, help="descriptor for the count of frames, or -1")
    options = parser.parse_args()
    summary = record(options.path, options.channel, sys.stdin.buffer, options.progress)
    os.write(1, json.dumps(summary).encode("ascii"))
    return 0


class _BlfWriter(can.BLFWriter):
    """python-can's writer, which buffers 128 KiB, and writes the start time only at the end.

    ``frames_in_file``  number of objects in the file at its last update
    """

    frames_in_file = 0

    def bring_up_to_date(self) -> None:
        """Write all buffered frames, and a header with their number and the start time."""
        self._flush()
        if self.file.seekable():
            end = self.file.tell()
            self.file.seek(0)
            self._write_header(end)
            self.file.seek(end)
        self.file.flush()
        self.frames_in_file = self.object_count


class _SqliteWriter(can.SqliteWriter):
    """python-can's writer, which writes in a thread of its own and drops the thread's errors.

    ``error``  what has ended the thread; None while it writes
    """

    error: Exception | None = None

    def _db_writer_thread(self) -> None:
        try:
            super()._db_writer_thread()
        except Exception as error:  # a database may raise anything
            self.error = error

    def on_message_received(self, msg: can.Message) -> None:
        if self.error is not None:
            raise self.error
        super().on_message_received(msg)


def _writer_of(path: Path) -> MessageWriter:
    suffix = path.suffix.lower()
    if suffix == ".blf":
        return _BlfWriter(path)
    return _SqliteWriter(path) if suffix == ".db" else can.Logger(path)


class _Record(NamedTuple):
    """One recorded frame; sorts by time, then by order of recording."""

    time_ns: int
    number: int
    frame: Frame
    is_received: bool


def record(path: Path, channel: str, source: BinaryIO, progress: int) -> dict[str, Any]:
    """Write every record in ``source`` to ``path``, up to a failure.

    Returns frames, left_out and failure.

    ``progress``  descriptor of the file for the number of frames in ``path``; -1: none

    Prints "ready" on standard output when the file is open.
    """
    counts = {"frames": 0, "left_out": 0, "flushed": 0}
    failure = ""
    writer: MessageWriter | None = None
    try:
        if path.is_file() and not path.is_symlink():
            path.unlink()  # the writer for .db would append to it
        writer = _writer_of(path)
        os.write(1, b"ready\n")
        _write_all(writer, path.suffix.lower(), channel, _records(source), counts, progress)
    except Exception as error:  # a writer may raise anything
        failure = cause_of(error)
    try:
        if writer is not None:
            _settle(writer, counts["frames"])
            writer.stop()
    except Exception as error:
        failure = failure or cause_of(error)
    if isinstance(writer, _SqliteWriter) and writer.error is not None:
        failure = failure or cause_of(writer.error)
    if failure and writer is not None:
        counts["frames"] = _frames_in_file(writer, counts["flushed"])
    del counts["flushed"]
    return {**counts, "failure": failure}


def _write_all(
    writer: MessageWriter,
    suffix: str,
    channel: str,
    reads: Iterator[list[_Record]],
    counts: dict[str, int],
    progress: int,
) -> None:
    """Write all records in order of time; counts them as it goes."""
    left_out = LEFT_OUT.get(suffix, 0)
    sync, shown = _sync_of(writer), 0
    for records in _ordered(reads):
        for time_ns, _, frame, is_received in records:
            if frame.flags & left_out:
                counts["left_out"] += 1
                continue
            message = message_of(frame)
            message.timestamp = time_ns * 1e-9
            message.channel = channel
            message.is_rx = is_received
            writer.on_message_received(message)
            counts["frames"] += 1
        if isinstance(writer, TextIOMessageWriter):
            writer.file.flush()
        counts["flushed"] = counts["frames"]
        if sync is not None:
            sync.after_write(len(records))
        in_file = _frames_in_file(writer, counts["frames"])
        if progress >= 0 and in_file != shown:
            os.pwrite(progress, PROGRESS.pack(in_file), 0)
            shown = in_file


def _frames_in_file(writer: MessageWriter, given: int) -> int:
    """Return how many of ``given`` frames would be in the file if the writer were killed now."""
    if isinstance(writer, TextIOMessageWriter):
        return given
    if isinstance(writer, _BlfWriter):
        return writer.frames_in_file
    return writer.num_frames if isinstance(writer, _SqliteWriter) else 0


def _sync_of(writer: MessageWriter) -> "Sync | None":
    """Return what syncs the file to the disk; None for a format that does so itself."""
    if isinstance(writer, TextIOMessageWriter):
        return Sync(writer.file.fileno())
    if not isinstance(writer, _BlfWriter):
        return None

    def sync(descriptor: int) -> None:
        writer.bring_up_to_date()
        os.fsync(descriptor)

    return Sync(writer.file.fileno(), sync)


class Sync:
    """Syncs a file to the disk, at most once in SYNC_NS.

    Flushing protects against a killed process, this against a failing machine.
    """

    def __init__(
        self,
        descriptor: int,
        sync: Callable[[int], None] = os.fsync,
        clock_ns: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._descriptor = descriptor
        self._sync = sync
        self._clock_ns = clock_ns
        self._due_ns = clock_ns() + SYNC_NS
        self._is_behind = False

    def after_write(self, written: int) -> None:
        """Count ``written`` records that were flushed, and sync when due."""
        self._is_behind = self._is_behind or written > 0
        if self._is_behind and self._clock_ns() >= self._due_ns:
            try:
                self._sync(self._descriptor)
            except OSError as error:
                if error.errno != errno.EINVAL:  # that of a pipe or a device
                    raise
            self._is_behind = False
            # From the end, so that a slow disk does not take all of the time.
            self._due_ns = self._clock_ns() + SYNC_NS


def _ordered(reads: Iterator[list[_Record]]) -> Iterator[list[_Record]]:
    """Yield the records in order of time, as far as HELD_NS goes.

    A read without records is a pause: all held records are yielded.
    """
    held: list[_Record] = []
    newest_ns = 0
    for records in reads:
        if not records:
            yield sorted(held)
            held.clear()
            continue
        for item in records:
            heapq.heappush(held, item)
            newest_ns = max(newest_ns, item.time_ns)
        ripe = []
        while held and held[0].time_ns <= newest_ns - HELD_NS:
            ripe.append(heapq.heappop(held))
        yield ripe
    yield sorted(held)


def _records(source: BinaryIO) -> Iterator[list[_Record]]:
    """Yield the complete records of each read until the pipe ends, and an empty list for a pause.

    All reads use one buffer, because varying sizes would fragment the memory.
    """
    buffer = bytearray(_READ_BYTES)
    view = memoryview(buffer)
    filled = number = 0
    with FileIO(source.fileno(), closefd=False) as pipe:
        while True:
            if not _comes(source):
                yield []
                continue
            count = pipe.readinto(view[filled:])
            if not count:
                return
            filled += count
            records = []
            place = 0
            while filled - place >= RECORD.size:
                time_ns, can_id, flags, direction, length = RECORD.unpack_from(buffer, place)
                end = place + RECORD.size + length
                if filled < end:
                    break
                frame = Frame(can_id, bytes(view[place + RECORD.size : end]), flags)
                records.append(_Record(time_ns, number, frame, bool(direction)))
                number += 1
                place = end
            # Move the incomplete record to the front.
            buffer[: filled - place] = buffer[place:filled]
            filled -= place
            if records:
                yield records


def _comes(source: BinaryIO) -> bool:
    """Wait for data or the end of the pipe; returns whether it came within IDLE_S."""
    if sys.platform == "win32":
        return True  # select takes no pipes there, so the read blocks
    return bool(select.select([source], (), (), IDLE_S)[0])


def _settle(writer: MessageWriter, frames: int) -> None:
    """Wait for the thread of the writer for .db, which still writes at most one batch."""
    if isinstance(writer, _SqliteWriter):
        before, patience_s = -1, 0.0
        while writer.num_frames < frames and patience_s < _SETTLE_S and writer.error is None:
            patience_s = 0.0 if writer.num_frames > before else patience_s + _POLL_S
            before = writer.num_frames
            time.sleep(_POLL_S)


if __name__ == "__main__":
    sys.exit(main())
