"""What reading a log needs and leaves: its frames, its lines, and a count of what is not read."""

import gzip
import io
from collections import deque
from pathlib import Path
from typing import NamedTuple

from ...runtime.frame import ERROR, EXTENDED, FD, Frame
from ...runtime.node import NS_PER_S
from ...runtime.settings import SettingsError
from ...runtime.settings.settings import encoding_of

LINE_LENGTH_MAX = 1 << 16
"""A longer line ends the log: binary data may have no line ends, and a device has no end."""
TIME_NS_LIMIT = 1 << 62
"""The year 2116: a later time is a misprint, and differences of times must fit into 64 bits."""
CLOCK_STARTED_NS = 631_152_000 * NS_PER_S
"""1990: greater times are dates; smaller ones count from some start."""


class LogError(SettingsError):
    """A log that cannot be read at all; the text is one line for the user."""


class NoFrameError(ValueError):
    """A line that cannot be read, and why, in words for the user."""


class Logged(NamedTuple):
    """A frame of a log; ``time_ns`` is None where the log has no times."""

    time_ns: int | None
    channel: str
    frame: Frame


def logged(time_ns: int | None, channel: str, frame: Frame) -> Logged:
    """Return a frame that a bus can carry, at a time that a clock can show; ValueError."""
    can_id, data, flags = frame
    if not 0 <= can_id < 1 << (29 if flags & (EXTENDED | ERROR) else 11):
        raise NoFrameError(f"an identifier of {can_id:#x}")
    if len(data) > (64 if flags & FD else 8):
        raise NoFrameError(f"{len(data)} bytes")
    if abs(time_ns or 0) >= TIME_NS_LIMIT:
        raise NoFrameError("a time that no clock shows")
    return Logged(time_ns, channel, frame)


class LogState:
    """How far a log has been read, and what of it could not be read.

    ``unreadable``        how many lines or objects could not be read so far
    ``first_unreadable``  the first of them, with its place
    ``cut_off``           why something is missing at the end, once that is reached
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.unreadable = 0
        self.first_unreadable = self.cut_off = ""
        self._raw = path.open("rb")
        self._size = max(path.stat().st_size, 1)

    @property
    def fraction_read(self) -> float | None:
        """How much of the file has been read, 0 to 1; None where that is not known."""
        if self._raw.closed:
            return 1.0
        return min(self._raw.tell() / self._size, 1.0) if self._raw.seekable() else None

    def count_unreadable(self, why: str) -> None:
        """Count what was read last."""
        self.unreadable += 1
        self.first_unreadable = self.first_unreadable or f"{self.path}: {why}"

    def close(self) -> None:
        """Close the file."""
        self._raw.close()


class TextLines(LogState):
    """Iterates over the lines of ``path``, unpacked if its name ends with .gz; OSError.

    ``has_end``  whether the line that was read last ends with a line end
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.number = 0
        self.has_end = True
        self._again: deque[str] = deque()
        try:
            file = gzip.GzipFile(fileobj=self._raw) if path.suffix == ".gz" else self._raw
            encoding = encoding_of(file.peek(3))
        except BaseException:
            self._raw.close()
            raise
        self._file = io.TextIOWrapper(file, encoding, errors="replace")

    def __iter__(self) -> "TextLines":
        return self

    def __next__(self) -> str:
        line = self._again.popleft() if self._again else self._file.readline(LINE_LENGTH_MAX)
        if not line:
            raise StopIteration
        self.number += 1
        self.has_end = line.endswith("\n")
        if len(line) >= LINE_LENGTH_MAX and not self.has_end:
            self.count_unreadable(f"no text: a line of more than {LINE_LENGTH_MAX} characters")
            raise StopIteration
        return line

    def begins_with(self, text: str) -> bool:
        """Whether the next line begins so; it is still the next one."""
        for line in self:
            self.put_back([line])
            return line.startswith(text)
        return False

    def put_back(self, lines: list[str]) -> None:
        """Put the newest ``lines`` back before those that are left."""
        self._again.extendleft(reversed(lines))
        self.number -= len(lines)

    def count_unreadable(self, why: str) -> None:
        """Count the line that was read last."""
        if not self.has_end:
            why = why if why.startswith("no text") else "the last line has no end"
            self.cut_off = why
        self.unreadable += 1
        self.first_unreadable = self.first_unreadable or f"{self.path}:{self.number}: {why}"

    def close(self) -> None:
        """Close the file."""
        self._file.close()
        self._raw.close()
