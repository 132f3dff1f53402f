"""A disk that fails from, or at, its n-th use: opening, writing, syncing, renaming, making folders.

In this process, for files below one folder, as far as they are written by Python. What a library
writes by itself (sqlite, Arrow) does not fail.
"""

import builtins
import errno
import io
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest


class FailingDisk:
    """Counts uses, and lets number ``fails_at`` fail, and all later ones.

    ``uses``  so far
    ``has_failed``  whether one has failed
    """

    def __init__(self, folder: Path, fails_at: int | None) -> None:
        self._folder = str(folder.resolve())
        self._fails_at = fails_at
        self.uses = 0
        self.has_failed = False

    def use(self, file: str | None = None) -> None:
        """Count a use; raises OSError when it fails, as the system does: of a name, or without."""
        self.uses += 1
        if self._fails_at is not None and self.uses >= self._fails_at:
            self.has_failed = True
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), *([file] if file else []))

    def has(self, file: Any) -> bool:
        """Whether a file is on this disk."""
        if not isinstance(file, str | os.PathLike):
            return False
        return os.path.abspath(os.fspath(file)).startswith(self._folder)

    def open(self, file: Any, mode: str = "r", *arguments: Any, **named: Any) -> Any:
        """Open a file as ``open`` does; what is written to this disk may fail."""
        if not self.has(file) or not set(mode) & set("wax+"):
            return _OPEN(file, mode, *arguments, **named)
        self.use(os.fspath(file))
        names = ("buffering", "encoding", "errors", "newline")
        named |= dict(zip(names, arguments, strict=False))
        raw = _RawFile(file, mode.replace("t", "").replace("b", ""))
        raw.disk = self
        if named.pop("buffering", -1) == 0:
            return raw
        buffered = io.BufferedRandom(raw) if "+" in mode else io.BufferedWriter(raw)
        return buffered if "b" in mode else io.TextIOWrapper(buffered, **named)

    def wrapped(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return a function of ``os`` that fails with the disk."""

        def call(file: Any, *arguments: Any, **named: Any) -> Any:
            is_there = function is _MKDIR and os.path.isdir(file)
            if not is_there and (isinstance(file, int) or self.has(file)):
                self.use(None if isinstance(file, int) else os.fspath(file))
            return function(file, *arguments, **named)

        return call


_OPEN, _MKDIR = io.open, os.mkdir


class _RawFile(io.FileIO):
    disk: FailingDisk

    def write(self, data: Any) -> int:
        self.disk.use()
        return super().write(data)


@contextmanager
def failing_disk(folder: Path, fails_at: int | None) -> Iterator[FailingDisk]:
    """Let what is written below ``folder`` fail from use ``fails_at`` on; None: never."""
    disk = FailingDisk(folder, fails_at)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(builtins, "open", disk.open)
        patch.setattr(io, "open", disk.open)
        for name in ("fsync", "replace", "rename", "mkdir"):
            patch.setattr(os, name, disk.wrapped(getattr(os, name)))
        yield disk
