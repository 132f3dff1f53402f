"""A log file, by its suffix: .asc, .blf, .csv, .trc; each other is what candump has printed.

What cannot be read is counted and costs nothing else. A killed writer leaves a last line without
its line end. That line is dropped: half a payload would read as a whole frame of a wrong length.
"""

import gzip
import io
import zlib
from collections.abc import Callable, Generator, Iterator
from pathlib import Path

from ...runtime.settings.settings import encoding_of
from .blf_log import BlfLog
from .candump_text import CandumpReader
from .log_state import LogError, Logged, LogState, NoFrameError
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


class TextLog(LogState):
    """The frames of a text, unpacked if its name ends with .gz, and what could not be read of it.

    ``read``  reads a line, as in ``text_formats``
    """

    def __init__(self, path: Path, read: Callable[[str], Logged | None]) -> None:
        super().__init__(path)
        self._read, self._has_end = read, True
        try:
            file = gzip.GzipFile(fileobj=self._raw) if path.suffix == ".gz" else self._raw
            encoding = encoding_of(file.peek(3))
        except BaseException:
            self._raw.close()
            raise
        self._file = io.TextIOWrapper(file, encoding, errors="replace")

    def frames(self) -> Iterator[Logged]:
        """Yield the frames."""
        has_header = isinstance(self._read, TrcReader)  # in lines that are comments elsewhere
        has_frames = False
        while line := self._file.readline(LINE_LENGTH_MAX):
            self._line_number += 1
            self._has_end = line.endswith("\n")
            if len(line) >= LINE_LENGTH_MAX and not self._has_end:
                self.count_unreadable(f"no text: a line of more than {LINE_LENGTH_MAX} characters")
                return
            if self._line_number > LINES_MAX and not has_frames:
                raise LogError(f"{self.path}: no frame in its first {LINES_MAX} lines")
            if line.lstrip().startswith(_COMMENTS) and not has_header:
                continue
            try:
                taken = self._read(line)
            except LogError as error:
                raise LogError(f"{self.path}: {error}") from error
            except (ValueError, LookupError, OverflowError) as error:
                why = f" ({error})" if isinstance(error, NoFrameError) else ""
                self.count_unreadable(f"no frame: {line.strip()[:60]!r}{why}")
                continue
            if taken is not None and self._has_end:
                has_frames = True
                yield taken
            elif taken is not None:
                self.count_unreadable("no end")

    def count_unreadable(self, why: str) -> None:
        """Count the line that was read last."""
        if not self._has_end:
            why = self.cut_off = why if why.startswith("no text") else "the last line has no end"
        super().count_unreadable(why)

    def close(self) -> None:
        """Close the file."""
        self._file.close()
        super().close()


class LogFile:
    """A log file: yields the frames, once; raises LogError if there are none.

    ``state``  how far it has been read, and what could not be read
    """

    def __init__(self, log: BlfLog | TextLog) -> None:
        self.state: LogState = log
        self._frames = log.frames()

    def __iter__(self) -> Generator[Logged, None, None]:
        count = 0
        try:
            for count, taken in enumerate(self._frames, start=1):  # noqa: B007 read below
                yield taken
        except (OSError, EOFError, zlib.error) as error:  # a .gz that is truncated or damaged
            if not count:
                raise LogError(f"{self.state.path}: {error}") from error
            self.state.count_unreadable(str(error))
            self.state.cut_off = str(error)
        finally:
            self.state.close()
        if not count:
            why = f"{self.state.path}: there is no frame in it"
            raise LogError(self.state.first_unreadable or why)


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
        if suffix == ".blf":
            return LogFile(BlfLog(path))
        return LogFile(TextLog(path, READERS.get(inner, CandumpReader)()))
    except (OSError, EOFError) as error:
        raise LogError(f"{path}: {getattr(error, 'strerror', None) or error}") from error
