"""A log file, by its suffix: .asc, .blf, .csv, .trc; each other is what candump has printed.

What cannot be read is counted and costs nothing else. A killed writer leaves a last line without
its line end. That line is dropped: half a payload would read as a whole frame of a wrong length.
"""

import gzip
import io
import zlib
from collections.abc import Callable, Generator
from pathlib import Path

from ...runtime.settings.settings import encoding_of
from .blf_log import BlfReader
from .candump_text import CandumpReader
from .logged import LogError, Logged, NoFrameError
from .text_formats import READERS, TrcReader

_COMMENTS = ("#", ";", "//")
LINE_LENGTH_MAX = 1 << 16
"""A longer line ends the log: binary data may have no line ends, and a device has no end."""
LINES_MAX = 1_000_000
"""Without a frame: a device has no end, and a few bytes unpack to as many."""
_CONVERTED = {".db": "", ".mf4": " (needs asammdf)"}
"""Suffixes of logs that python-can converts, and what it needs for that."""
OF_LOCAL_TIME = {".blf", ".trc"}
"""Their dates are the recorder's, whose time zone they do not tell."""


class LogFile:
    """A log file: yields the frames, once.

    ``unreadable``        how many lines or objects could not be read so far
    ``first_unreadable``  the first of them, with its place
    ``cut_off``           why something is missing at the end, once that is reached

    ``suffix``     says its format
    ``is_packed``  whether it is to be unpacked first

    Iterating raises LogError if there is no frame.
    """

    def __init__(self, path: Path, suffix: str, *, is_packed: bool) -> None:
        self._path, self._suffix, self._is_packed = path, suffix, is_packed
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

    def __iter__(self) -> Generator[Logged, None, None]:
        has_frames = False
        try:
            for taken in self._objects() if self._suffix == ".blf" else self._lines():
                has_frames = True
                yield taken
        except LogError as error:
            raise LogError(f"{self._path}: {error}") from error
        except (OSError, EOFError, zlib.error) as error:  # a .gz that is truncated or damaged
            if not has_frames:
                raise LogError(f"{self._path}: {error}") from error
            self.cut_off = str(error)
            self._count_unreadable(self.cut_off)
        finally:
            self._raw.close()
        if not has_frames:
            raise LogError(self.first_unreadable or f"{self._path}: there is no frame in it")

    def _objects(self) -> Generator[Logged, None, None]:
        reader = BlfReader(self._raw, self._size, self._count_unreadable)
        yield from reader.frames()
        self.cut_off = reader.cut_off

    def _lines(self) -> Generator[Logged, None, None]:
        """Yield the frames of a text."""
        file = gzip.GzipFile(fileobj=self._raw) if self._is_packed else self._raw
        with io.TextIOWrapper(file, encoding_of(file.peek(3)), errors="replace") as text:
            yield from self._frames_in(text, READERS.get(self._suffix, CandumpReader)())

    def _frames_in(
        self, text: io.TextIOWrapper, read: Callable[[str], Logged | None]
    ) -> Generator[Logged, None, None]:
        has_frames, has_header = False, isinstance(read, TrcReader)
        while line := text.readline(LINE_LENGTH_MAX):
            self._line_number += 1
            has_end = line.endswith("\n")
            if len(line) >= LINE_LENGTH_MAX and not has_end:
                self.cut_off = f"no text: a line of more than {LINE_LENGTH_MAX} characters"
                self._count_unreadable(self.cut_off)
                return
            if self._line_number > LINES_MAX and not has_frames:
                raise LogError(f"no frame in its first {LINES_MAX} lines")
            if line.lstrip().startswith(_COMMENTS) and not has_header:
                continue
            try:
                taken, why = read(line), ""
            except LogError:
                raise
            except (ValueError, LookupError, OverflowError) as error:
                why = f" ({error})" if isinstance(error, NoFrameError) else ""
                taken, why = None, f"no frame: {line.strip()[:60]!r}{why}"
            if (taken or why) and not has_end:
                taken, why = None, "the last line has no end"
                self.cut_off = why
            if why:
                self._count_unreadable(why)
            if taken is not None:
                has_frames = True
                yield taken

    def _count_unreadable(self, why: str) -> None:
        """Count what was read last."""
        self.unreadable += 1
        place = f":{self._line_number}" if self._line_number else ""
        self.first_unreadable = self.first_unreadable or f"{self._path}{place}: {why}"


def open_log(path: Path) -> LogFile:
    """Open a log file; raises LogError."""
    suffix = path.suffix.lower()
    inner = Path(path.stem).suffix.lower() if suffix == ".gz" else suffix
    if suffix != inner and inner in {".blf", *_CONVERTED}:
        raise LogError(f"{path}: unpack it first (gunzip)")
    if suffix in _CONVERTED:
        convert = f"python -m can.logconvert {path.name} {path.stem}.blf{_CONVERTED[suffix]}"
        raise LogError(f"{path}: a {suffix} is not read; convert it: {convert}")
    try:
        return LogFile(path, inner, is_packed=suffix != inner)
    except OSError as error:
        raise LogError(f"{path}: {error.strerror or error}") from error
