"""What reading a log needs and leaves: frames, times, and a count of what is not read."""

from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from ...runtime.frame import ERROR, EXTENDED, FD, Frame
from ...runtime.node import NS_PER_S
from ...runtime.settings import SettingsError

TIME_NS_LIMIT = 1 << 62
"""The year 2116: a later time is a misprint, and differences of times must fit into 64 bits."""
CLOCK_STARTED_NS = 631_152_000 * NS_PER_S
"""1990: greater times are dates; smaller ones count from some start."""
CLOCK_SET_NS = 24 * 3600 * NS_PER_S
"""A longer time without any frame is a clock that was set, from 1970 to the date for instance."""
CLOCK_SET_BACK_NS = NS_PER_S // 10
"""Frames that lie further back than a recorder swaps them, two in a row, are a clock set back."""


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
        self._line_number = 0
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
        place = f":{self._line_number}" if self._line_number else ""
        self.first_unreadable = self.first_unreadable or f"{self.path}{place}: {why}"

    def close(self) -> None:
        """Close the file."""
        self._raw.close()


class TimeAxis:
    """The times of a log since its first frame, without what a clock that was set has leapt.

    ``clock_set``  how often it was set forward, by more than a day
    ``set_back``   how often it was set back
    ``backwards``  other frames so far whose time is before that of an earlier one
    ``at_rest``    frames at the newest time so far, which are few if the clock is fine enough
    """

    def __init__(self) -> None:
        self._start_ns: int | None = None
        self._end_ns = 0
        self._aside_ns: int | None = None  # of the frame before, if it lies far back
        self.backwards = self.clock_set = self.set_back = self.at_rest = 0

    def since_start_ns(self, time_ns: int | None) -> int | None:
        """Return the time of the next frame since the start [ns]; None for one without time."""
        if time_ns is None:
            return None
        if self._start_ns is None:
            self._start_ns = self._end_ns = time_ns
        aside_ns, self._aside_ns = self._aside_ns, None
        if time_ns < self._end_ns - CLOCK_SET_BACK_NS:
            if aside_ns is None or not 0 <= time_ns - aside_ns <= CLOCK_SET_BACK_NS:
                self.backwards += 1
                self._aside_ns = time_ns
                return self._end_ns - self._start_ns
            self.backwards -= 1
            self.set_back += 1
            self._start_ns += aside_ns - self._end_ns
            self._end_ns = time_ns
        self.at_rest += time_ns == self._end_ns
        if time_ns < self._end_ns:
            self.backwards += 1
        if time_ns - self._end_ns > CLOCK_SET_NS:
            self._start_ns += time_ns - self._end_ns
            self.clock_set += 1
        self._end_ns = max(self._end_ns, time_ns)
        return time_ns - self._start_ns

    @property
    def duration_ns(self) -> int | None:
        """From the first to the last frame [ns]; None in a log without times."""
        return None if self._start_ns is None else self._end_ns - self._start_ns

    @property
    def start_date(self) -> str | None:
        """The date of the start; None where times are not dates."""
        if self._start_ns is None or self._start_ns < CLOCK_STARTED_NS:
            return None
        start = datetime.fromtimestamp(self._start_ns / NS_PER_S, UTC)
        return start.isoformat(timespec="microseconds")
