"""A folder in TMPDIR for as long as a program runs, and the end of those that killed ones left.

A file in each folder is locked by the program that made it: the kernel gives the lock back however
the program ends. Whoever makes a folder removes those of this user that nobody locks any more and
that are KEPT_S old. Until then what a killed program has recorded can be fetched.

Windows has no such locks, and leaves what a killed program has left.
"""

import os
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

PREFIX = "steer-by-wire-"
KEPT_S = 24 * 3600.0
_LOCK = "in_use"


@contextmanager
def private_folder(kind: str) -> Iterator[Path]:
    """Make a folder that only this user can read, and remove it at the end of the block.

    ``kind``  of its content, part of its name
    """
    if sys.platform != "win32":
        _sweep(Path(tempfile.gettempdir()))
    with ExitStack() as stack:
        made = tempfile.TemporaryDirectory(prefix=f"{PREFIX}{kind}-", ignore_cleanup_errors=True)
        folder = Path(stack.enter_context(made))
        if sys.platform != "win32":
            # Under its name only when it is locked, so that nobody finds it unlocked.
            unnamed = folder / f".{_LOCK}"
            unnamed.touch()
            stack.enter_context(_locked(unnamed))
            unnamed.rename(folder / _LOCK)
        yield folder


def _sweep(place: Path) -> None:
    """Remove the folders in ``place`` that killed programs of this user have left."""
    for folder in place.glob(f"{PREFIX}*/"):
        with suppress(OSError):  # it is another user's, in use, or has gone meanwhile
            is_own = folder.lstat().st_uid == os.getuid() and not folder.is_symlink()
            newest_s = max(entry.lstat().st_mtime for entry in (folder, *folder.iterdir()))
            if is_own and time.time() - newest_s > KEPT_S:
                with _locked(folder / _LOCK):
                    shutil.rmtree(folder)


@contextmanager
def _locked(file: Path) -> Iterator[None]:
    """Hold the lock of a file; raises OSError when there is none, or another program has it."""
    import fcntl  # does not exist on Windows

    descriptor = os.open(file, os.O_RDWR | os.O_NOFOLLOW)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    finally:
        os.close(descriptor)
