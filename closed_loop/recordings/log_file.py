"""A log file, by its suffix: .asc, .blf, .csv, .trc; each other is what candump has printed.

What cannot be read is counted and costs nothing else. A killed writer leaves a last line without
its line end. That line is dropped: half a payload would read as a whole frame of a wrong length.
"""

import zlib
from collections.abc import Callable, Generator, Iterator
from pathlib import Path

from .blf_log import BlfLog
from .candump_text import candump_reader
from .log_state import LogError, Logged, LogState, NoFrameError, TextLines
from .text_formats import READERS, TrcReader

_COMMENTS = ("#", ";", "//")
LINES_MAX = 1_000_000
"""Without a frame: a device has no end, and a few bytes unpack to as many."""
_CONVERTED = {".db": "", ".mf4": " (needs asammdf)"}
"""Suffixes of logs that python-can converts, and what it needs for that."""
OF_LOCAL_TIME = {".blf", ".trc"}
"""Their dates are the recorder's, whose time zone they do not tell."""


class LogFile:
    """A log file: yields the frames, once; raises LogError if there are none.

    ``state``  how far it has been read, and what could not be read
    """

    def __init__(self, state: LogState, frames: Iterator[Logged]) -> None:
        self.state, self._frames = state, frames

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
            objects = BlfLog(path)
            return LogFile(objects, objects.frames())
        lines = TextLines(path)
    except (OSError, EOFError) as error:
        raise LogError(f"{path}: {getattr(error, 'strerror', None) or error}") from error
    return LogFile(lines, _text_frames(lines, READERS.get(inner, candump_reader)()))


def _text_frames(lines: TextLines, read: Callable[[str], Logged | None]) -> Iterator[Logged]:
    """Yield the frames of a text."""
    is_trc = isinstance(read, TrcReader)  # its header is in such lines
    has_frames = False
    for line in lines:
        if lines.number > LINES_MAX and not has_frames:
            raise LogError(f"{lines.path}: no frame in its first {LINES_MAX} lines")
        if line.lstrip().startswith(_COMMENTS) and not is_trc:
            continue
        try:
            taken = read(line)
        except LogError as error:
            raise LogError(f"{lines.path}: {error}") from error
        except (ValueError, LookupError, OverflowError) as error:
            why = f" ({error})" if isinstance(error, NoFrameError) else ""
            lines.count_unreadable(f"no frame: {line.strip()[:60]!r}{why}")
            continue
        if taken is not None and lines.has_end:
            has_frames = True
            yield taken
        elif taken is not None:
            lines.count_unreadable("no end")
