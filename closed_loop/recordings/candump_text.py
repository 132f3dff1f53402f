"""Reads the output of candump, whatever its options; and lines of text for python-can's readers.

    (1436509052.249713) vcan0 044#2A366C2BBA      candump -L and -l, canplayer, python-can's .log
     (1436509052.249713)  vcan0  044   [5]  2A 36 6C 2B BA                candump -ta (-tz, -tA)
     (000.010000)  vcan0  RX - -  044   [5]  2A 36 6C 2B BA               candump -td -x
      vcan0  044   [5]  2A 36 6C 2B BA                                    candump: no times

A line that cannot be read is counted and skipped. A killed writer leaves a last line without its
line end. That line is dropped: half a payload would read as a whole frame of a wrong length.
"""

import gzip
import re
from collections import deque
from collections.abc import Callable, Iterator
from datetime import datetime
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from ...runtime.frame import ERROR, EXTENDED, FD, REMOTE, Frame
from ...runtime.node import NS_PER_S
from ...runtime.recording.candump import parse_entry

SEEN_MAX = 1000
"""How many lines from the beginning are kept: far more than any format's header."""
LINE_BYTES_MAX = 1 << 16
"""A longer line ends the log: binary data may have no line ends, and a device has no end."""


class TextLines:
    """Iterates over the lines of ``path``, unpacked if its name ends with .gz; OSError."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.seen: list[str] = []
        self.unreadable = 0
        self.first_unreadable = ""
        self.number = 0
        self._again: deque[str] = deque()
        self._raw = path.open("rb")
        self._size = max(path.stat().st_size, 1)
        self._file = gzip.GzipFile(fileobj=self._raw) if path.suffix == ".gz" else self._raw

    @property
    def fraction_read(self) -> float:
        """How much of the file has been read, 0 to 1."""
        return 1.0 if self._raw.closed else min(self._raw.tell() / self._size, 1.0)

    def __iter__(self) -> "TextLines":
        return self

    def __next__(self) -> str:
        if self._again:
            return self._again.popleft()
        raw = self._file.readline(LINE_BYTES_MAX)
        if not raw:
            raise StopIteration
        self.number += 1
        if not raw.endswith(b"\n"):
            is_cut = len(raw) < LINE_BYTES_MAX
            self.count_unreadable(
                "the last line has no end: its writer was killed in the middle"
                if is_cut
                else f"no text: a line of more than {LINE_BYTES_MAX} bytes"
            )
            raise StopIteration
        line = raw.decode("utf-8", errors="replace").rstrip("\r\n")
        if len(self.seen) < SEEN_MAX:
            self.seen.append(line)
        return line

    def put_back(self, lines: list[str]) -> None:
        """Put ``lines`` back before those that are left."""
        self._again.extendleft(reversed(lines))

    def count_unreadable(self, why: str) -> None:
        """Count the line that was read last."""
        number = self.number - len(self._again)
        self.unreadable += 1
        self.first_unreadable = self.first_unreadable or f"{self.path}:{number}: {why}"

    def close(self) -> None:
        """Close the file; python-can's readers do it at the end, too."""
        self._file.close()
        self._raw.close()


_HEAD_LINES = 200
"""Lines from which to decide whether candump's times are differences (-td)."""
_CAN_ERR_FLAG = 0x20000000
TIME_NS_LIMIT = 1 << 62
"""The year 2116: a later time is a misprint, and differences of times must fit into 64 bits."""
CLOCK_STARTED_NS = 631_152_000 * NS_PER_S
"""1990: greater times are dates; smaller ones count from some start."""
_PLAIN = re.compile(
    r"""\s*(?:\(([^)]+)\)\s+)?              # time
        (\S+)\s+                             # channel
        (?:(?:RX|TX)\s+[B-]\s[E-]\s+)?       # candump -x
        ([0-9A-F]{3}|[0-9A-F]{8})\s+         # identifier
        \[(\d{1,2})\]                        # length; two digits for CAN FD
        (?:\s+(remote\ request)|((?:\s+[0-9A-F]{2})*))
        (?:\s+'.*'|\s+ERRORFRAME.*)?\s*      # candump -a; error frames
    """,
    re.ASCII | re.VERBOSE,
)


class Logged(NamedTuple):
    """A frame of a log; ``time_ns`` is None where the log has no times."""

    time_ns: int | None
    channel: str
    frame: Frame


def candump_frames(lines: TextLines) -> Iterator[Logged]:
    """Yield the frames of text that candump or python-can has printed."""
    head = [line for _, line in zip(range(_HEAD_LINES), lines, strict=False)]
    stamps = [match[1] for line in head if (match := _PLAIN.fullmatch(line)) and match[1]]
    lines.put_back(head)
    read_time = _distances() if _are_distances(stamps) else _time_ns
    for line in lines:
        entry = parse_entry(line)
        logged = _plain(line, read_time) if entry is None else Logged(*entry)
        if logged is not None and (logged.time_ns or 0) < TIME_NS_LIMIT:
            yield logged
        elif line.strip():
            lines.count_unreadable(f"no frame: {line.strip()[:60]!r}")


def _plain(line: str, read_time: Callable[[str], int | None]) -> Logged | None:
    """Read a line as candump prints it without -L; None if it is no frame."""
    match = _PLAIN.fullmatch(line)
    if match is None:
        return None
    stamp, channel, identifier, length, remote, payload = match.groups()
    data = bytes.fromhex(payload or "")
    can_id = int(identifier, 16)
    flags = FD if len(length) == 2 else 0
    if len(identifier) == 8:
        flags |= ERROR if can_id & _CAN_ERR_FLAG else EXTENDED
        can_id &= ~_CAN_ERR_FLAG
    flags |= REMOTE if remote else 0
    if not remote and len(data) != int(length):
        return None
    time_ns = read_time(stamp) if stamp else None
    if stamp and time_ns is None:
        return None
    return Logged(time_ns, channel, Frame(can_id, data, flags))


def _time_ns(stamp: str) -> int | None:
    """Read a time as candump -ta, -tz or -tA prints it [ns]."""
    seconds, _, fraction = stamp.partition(".")
    if not (fraction.isdecimal() and len(fraction) <= 9):
        return None
    if seconds.isdecimal():
        whole = int(seconds)
    else:
        try:
            whole = round(datetime.fromisoformat(seconds).timestamp())  # local, as candump's
        except ValueError:
            return None
    return whole * NS_PER_S + int(fraction.ljust(9, "0"))


def _are_distances(stamps: list[str]) -> bool:
    """Whether times are those of candump -td, not -tz: as times they would run backwards."""
    times = [time_ns for stamp in stamps if (time_ns := _time_ns(stamp)) is not None]
    if max(times, default=0) >= CLOCK_STARTED_NS:
        return False
    # Differences fall as often as they rise; times hardly ever step back.
    backwards = sum(after < before for before, after in pairwise(times))
    return 10 * backwards > len(times)


def _distances() -> Callable[[str], int | None]:
    """Return a function that reads differences and adds them up."""
    now_ns = 0

    def read(stamp: str) -> int | None:
        nonlocal now_ns
        distance_ns = _time_ns(stamp)
        now_ns += distance_ns or 0
        return None if distance_ns is None else now_ns

    return read
