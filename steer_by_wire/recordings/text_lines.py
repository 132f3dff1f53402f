"""The lines of a text file as python-can's readers need them: numbered, and lines can be put back.

A killed writer leaves a last line without its line end. That line is dropped: half a payload would
read as a whole frame of a wrong length.
"""

import gzip
from collections import deque
from pathlib import Path

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
