"""Reads the frames of one log file: python-can's formats, and what candump prints.

The suffix decides for .asc, .blf, .csv, .db, .mf4 and .trc. Every other file is read as candump
text, line by line. A line that cannot be read is counted and skipped.
"""

from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import can

from ...runtime.command_line import installation
from ...runtime.frame.message import frame_of
from ...runtime.node import NS_PER_S
from ...runtime.settings import SettingsError
from ...runtime.settings.error_text import one_line
from .candump_text import TIME_NS_LIMIT, Logged, TextLines, candump_frames

_TEXT_READERS = {".asc": can.ASCReader, ".csv": can.CSVReader, ".trc": can.TRCReader}
_BINARY_SUFFIXES = {".blf", ".db", ".mf4"}


class LogError(SettingsError):
    """A log that cannot be read at all; the text is one line for the user."""


def open_log(path: Path) -> "_TextLog | _BinaryLog":
    """Open a log file; raises LogError.

    The result yields the frames, once; it raises LogError if there are none. It also has

    ``unreadable``        lines, or parts of a binary file, that could not be read so far
    ``first_unreadable``  the first of them, with file and line number; empty when there is none
    ``fraction_read``     how much of the file has been read, 0 to 1; None where that is not known
    """
    suffix = path.suffix.lower()
    if suffix in _BINARY_SUFFIXES:
        return _BinaryLog(path)
    inner = Path(path.stem).suffix.lower() if suffix == ".gz" else suffix
    try:
        lines = TextLines(path)
    except OSError as error:
        raise LogError(f"{path}: {error.strerror or error}") from error
    if inner in _BINARY_SUFFIXES:
        lines.close()
        raise LogError(f"{path}: unpack it first (gunzip)")
    reader = _TEXT_READERS.get(inner)
    return _TextLog(lines, candump_frames(lines) if reader is None else _python_can(lines, reader))


class _TextLog:
    def __init__(self, lines: TextLines, frames: Iterator[Logged]) -> None:
        self._lines = lines
        self._frames = frames

    @property
    def unreadable(self) -> int:
        return self._lines.unreadable

    @property
    def first_unreadable(self) -> str:
        return self._lines.first_unreadable

    @property
    def fraction_read(self) -> float | None:
        return self._lines.fraction_read

    def __iter__(self) -> Iterator[Logged]:
        count = 0
        try:
            for count, logged in enumerate(self._frames, start=1):  # noqa: B007 read below
                yield logged
        except (OSError, EOFError) as error:  # a .gz that is truncated or no gzip file
            if not count:
                raise LogError(f"{self._lines.path}: {error}") from error
            self._lines.count_unreadable(str(error))
        finally:
            self._lines.close()
        if not count:
            raise LogError(
                self._lines.first_unreadable or f"{self._lines.path}: there is no frame in it"
            )


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
    return Logged(round(message.timestamp * NS_PER_S), channel, frame_of(message))


class _BinaryLog:
    """A log in a block format: reading ends at the first damaged block."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.unreadable = 0
        self.first_unreadable = ""
        if path.suffix.lower() == ".mf4" and find_spec("asammdf") is None:
            raise LogError(f"{path}: .mf4 needs asammdf: {installation('asammdf')}")
        try:
            with path.open("rb"):  # sqlite would create a missing file
                self._size = max(path.stat().st_size, 1)
            self._reader: Any = self._opened()
        except OSError as error:
            raise LogError(f"{path}: {error.strerror or error}") from error
        except Exception as error:
            raise LogError(f"{path}: no {path.suffix} file: {one_line(error)}") from error

    def _opened(self) -> Any:
        if self._path.suffix.lower() != ".blf":
            return can.LogReader(self._path)
        file = self._path.open("rb")
        try:
            return can.BLFReader(file)
        except Exception:
            file.close()  # a reader that failed leaves it open
            raise

    @property
    def fraction_read(self) -> float | None:
        if not isinstance(self._reader, can.BLFReader):
            return None
        return 1.0 if self._reader.file.closed else self._reader.file.tell() / self._size

    def __iter__(self) -> Iterator[Logged]:
        count = 0
        try:
            for message in self._reader:
                logged = _logged(message)
                count += 1
                yield logged
        except GeneratorExit:
            raise
        except Exception as error:  # whatever a reader stumbles over
            self.unreadable = 1
            self.first_unreadable = f"{self._path}: damaged after {count} frames: "
            self.first_unreadable += one_line(error)
        finally:
            self._reader.stop()
        if not count:
            raise LogError(self.first_unreadable or f"{self._path}: there is no frame in it")
