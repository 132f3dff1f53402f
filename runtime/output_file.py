"""Files that programs write: whole ones in one go, streams bit by bit. Every error names its file.

A file written in one go is there whole or as it was before, whatever fails or is killed: program,
disk or machine.
"""

import io
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO, TextIO, cast


def write_text(path: Path, text: str) -> None:
    """Write a text file in UTF-8 atomically; raises OSError."""
    write_file(path, text.encode(errors="surrogateescape"))  # a file's name has any bytes


def write_file(path: Path, content: bytes) -> None:
    """Write a file atomically; raises OSError."""
    if path.is_symlink() or (path.exists() and not path.is_file()):
        # A link, a pipe or a device such as /dev/stdout is written to, never replaced.
        with open_binary(path) as file:
            file.write(content)
        return
    write_whole(path, lambda partial: partial.write_bytes(content))


def write_whole(path: Path, write: Callable[[Path], object]) -> None:
    """Let ``write`` write a file under another name, and replace ``path`` by it; raises OSError."""
    partial = path.with_name(f".{path.name}.partial")
    try:
        write(partial)
        with partial.open("rb") as written:
            os.fsync(written.fileno())
        os.replace(partial, path)
    except OSError as error:
        partial.unlink(missing_ok=True)
        raise _naming(error, path) from error


def open_text(path: Path) -> TextIO:
    """Open a text file in UTF-8 to overwrite it, its line ends as given; raises OSError."""
    return io.TextIOWrapper(open_binary(path), encoding="utf-8", newline="\n")


def open_binary(path: Path) -> BinaryIO:
    """Open a file to overwrite it; raises OSError."""
    return cast(BinaryIO, io.BufferedWriter(_NamedFile(path)))


class _NamedFile(io.RawIOBase):
    """A file whose errors of writing name it; the system's do not."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = path.open("wb", buffering=0)

    def writable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return self._file.seekable()

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        return self._file.seek(offset, whence)

    def fileno(self) -> int:
        return self._file.fileno()

    def write(self, data: Any) -> int:
        try:
            return self._file.write(data)
        except OSError as error:
            raise _naming(error, self._path) from error

    def close(self) -> None:
        super().close()
        self._file.close()


def _naming(error: OSError, path: Path) -> OSError:
    return OSError(error.errno, error.strerror, str(path))
