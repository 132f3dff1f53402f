"""Frames of one log file, in python-can's formats or as candump prints them.

The suffix decides for .asc, .blf, .csv, .db, .mf4 and .trc. Every other file is read as the output
of candump, whatever its options:

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
from collections.abc import Callable, Generator, Iterator
from datetime import datetime
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import can

from ...runtime.exit_status import one_line
from ...runtime.frame import ERROR, EXTENDED, FD, REMOTE, Frame
from ...runtime.frame.message import frame_of
from ...runtime.node import NS_PER_S
from ...runtime.recording.candump import parse_entry
from ...runtime.settings import SettingsError
from .bounded_blf import BoundedBlfReader

SEEN_MAX = 1000
"""How many lines from the beginning are kept: far more than any format's header."""
LINE_BYTES_MAX = 1 << 16
"""A longer line ends the log: binary data may have no line ends, and a device has no end."""


class LogError(SettingsError):
    """A log that cannot be read at all; the text is one line for the user."""


class Logged(NamedTuple):
    """A frame of a log; ``time_ns`` is None where the log has no times."""

    time_ns: int | None
    channel: str
    frame: Frame


class TextLines:
    """Iterates over the lines of ``path``, unpacked if its name ends with .gz; OSError.

    ``unreadable``        how many could not be read so far
    ``first_unreadable``  the first of them, with file and line number
    ``cut_off``           why lines are missing at the end, once that is reached
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.seen: list[str] = []
        self.unreadable = 0
        self.first_unreadable = self.cut_off = ""
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
            is_last = len(raw) < LINE_BYTES_MAX
            long = f"no text: a line of more than {LINE_BYTES_MAX} bytes"
            self.cut_off = "the last line has no end" if is_last else long
            self.count_unreadable(self.cut_off)
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


_TEXT_READERS = {".asc": can.ASCReader, ".csv": can.CSVReader, ".trc": can.TRCReader}
_BINARY_SUFFIXES = {".blf", ".db", ".mf4"}


class LogFile:
    """A log file: yields the frames, once; raises LogError if there are none.

    ``state``  how far it has been read, and what could not be read
    """

    def __init__(self, state: "TextLines | _Blocks", frames: Iterator[Logged]) -> None:
        self.state, self._frames = state, frames

    def __iter__(self) -> Generator[Logged, None, None]:
        count = 0
        try:
            for count, logged in enumerate(self._frames, start=1):  # noqa: B007 read below
                yield logged
        except (OSError, EOFError) as error:  # a .gz that is truncated or no gzip file
            if not count:
                raise LogError(f"{self.state.path}: {error}") from error
            self.state.cut_off = str(error)
            self.state.count_unreadable(str(error))
        finally:
            self.state.close()
        if not count:
            why = f"{self.state.path}: there is no frame in it"
            raise LogError(self.state.first_unreadable or why)


def open_log(path: Path) -> LogFile:
    """Open a log file; raises LogError."""
    suffix = path.suffix.lower()
    inner = Path(path.stem).suffix.lower() if suffix == ".gz" else suffix
    if suffix != inner and inner in _BINARY_SUFFIXES:
        raise LogError(f"{path}: unpack it first (gunzip)")
    if suffix == ".mf4" and find_spec("asammdf") is None:
        raise LogError(f"{path}: .mf4 needs asammdf: pip install asammdf")
    try:
        if suffix in _BINARY_SUFFIXES:
            blocks = _Blocks(path)
            return LogFile(blocks, blocks.frames())
        lines = TextLines(path)
    except OSError as error:
        raise LogError(f"{path}: {error.strerror or error}") from error
    reader = _TEXT_READERS.get(inner)
    return LogFile(lines, candump_frames(lines) if reader is None else _python_can(lines, reader))


def _python_can(
    lines: TextLines, reader: Callable[..., can.io.generic.MessageReader]
) -> Iterator[Logged]:
    """Yield the frames of a text format that python-can reads.

    Its readers give up at the first line that they cannot read. A new reader then gets the header,
    which defines how lines are read, and the lines that are left.
    """
    header: list[str] | None = None
    messages = iter(reader(lines))
    begun_at = -1
    while True:
        try:
            message = next(messages, None)
            logged = None if message is None else _logged(message)
        except Exception as error:  # whatever a reader stumbles over
            header = lines.seen[:-1] if header is None else header
            lines.count_unreadable(f"no frame: {one_line(error)[:60]}")
            if lines.number == begun_at:
                return  # nothing is left but what it stumbles over
            begun_at = lines.number
            lines.put_back(header)
            messages = iter(reader(lines))
            continue
        if logged is None:
            return
        header = lines.seen[:-1] if header is None else header
        yield logged


def _logged(message: can.Message) -> Logged:
    channel = "" if message.channel is None else str(message.channel)
    if not abs(message.timestamp) * NS_PER_S < TIME_NS_LIMIT:  # rejects NaN too
        raise ValueError(f"a time of {message.timestamp:g} s")
    is_long = message.is_extended_id or message.is_error_frame
    if not 0 <= message.arbitration_id < 1 << (29 if is_long else 11):
        raise ValueError(f"an identifier of {message.arbitration_id:#x}")
    return Logged(round(message.timestamp * NS_PER_S), channel, frame_of(message))


class _Blocks:
    """A log in a format of blocks, as ``TextLines``: reading ends at the first damaged one."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.unreadable = 0
        self.first_unreadable = self.cut_off = ""
        with path.open("rb"):  # sqlite would create a missing file
            self._size = max(path.stat().st_size, 1)
        try:
            self._reader: Any = _bounded_blf(path) if path.suffix.lower() == ".blf" else None
            self._reader = self._reader or can.LogReader(path)
        except OSError:
            raise
        except Exception as error:
            raise LogError(f"{path}: no {path.suffix} file: {one_line(error)}") from error

    @property
    def fraction_read(self) -> float | None:
        """How much of the file has been read, 0 to 1; None where that is not known."""
        if not isinstance(self._reader, can.BLFReader):
            return None
        return 1.0 if self._reader.file.closed else self._reader.file.tell() / self._size

    def frames(self) -> Iterator[Logged]:
        """Yield the frames."""
        count = 0
        try:
            for message in self._reader:
                logged = _logged(message)
                count += 1
                yield logged
        except GeneratorExit:
            raise
        except Exception as error:  # whatever a reader stumbles over
            self.cut_off = f"damaged after {count} frames: {one_line(error)}"
            self.count_unreadable(self.cut_off)
        whole = self._reader.file_size if isinstance(self._reader, can.BLFReader) else 0
        if whole > self._size and not self.cut_off:
            self.cut_off = f"{self._size} of its {whole} bytes are there"

    def count_unreadable(self, why: str) -> None:
        """Count what could not be read."""
        self.unreadable += 1
        self.first_unreadable = self.first_unreadable or f"{self.path}: {why}"

    def close(self) -> None:
        """Close the file."""
        self._reader.stop()


def _bounded_blf(path: Path) -> BoundedBlfReader:
    file = path.open("rb")
    try:
        return BoundedBlfReader(file)
    except Exception:
        file.close()  # a reader that failed leaves it open
        raise
