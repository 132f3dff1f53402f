"""A shared library that speaks the lockstep protocol, within this process: nothing waits for pipes.

What crashes or hangs in it ends or holds up this process: a program of its own does not.
"""

import ctypes
import os
import shutil
import tempfile
from _ctypes import dlclose
from collections.abc import Sequence
from pathlib import Path
from typing import Self

from ...runtime.exit_status import printable
from ..processes.process_group import ProcessError
from .program import LockstepProgram
from .record import RECORD_BYTES, Record, RecordError, pack, unpack

ENDINGS = (".so", ".dylib")
FUNCTION = "lockstep_exchange"


class LockstepLibrary:
    """A library loaded for one run; a context manager that unloads it.

    A copy of the file is loaded: its variables are new in every run, also in runs side by side.

    Raises ProcessError when it cannot be loaded.
    """

    def __init__(self, command: Sequence[str]) -> None:
        file = command[0]
        self.name = os.path.basename(file)
        if len(command) > 1:
            raise ProcessError(f"{file}: a shared library takes no words: leave out {command[1]}")
        with tempfile.TemporaryDirectory() as folder:
            copy = Path(folder, self.name)
            try:
                shutil.copyfile(file, copy)
                self._library = ctypes.CDLL(str(copy))
            except OSError as error:
                said = error.strerror or str(error).removeprefix(f"{copy}: ")
                raise ProcessError(f"{file}: {printable(said)}") from error
        try:
            self._exchange = self._library[FUNCTION]
        except AttributeError as error:
            raise ProcessError(f"{file}: has no function {FUNCTION}: see lockstep.h") from error
        self._exchange.restype = None
        self._record = ctypes.create_string_buffer(RECORD_BYTES)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        dlclose(self._library._handle)

    def exchange(self, record: Record) -> Record:
        """Hand a record over; returns the answer. Raises ProcessError when there is none to use."""
        self._record.raw = pack(record)
        self._exchange(self._record)
        try:
            return unpack(self._record.raw)
        except RecordError as error:
            raise ProcessError(f"{self.name}: its answer: {error}") from error


LockstepPeer = LockstepProgram | LockstepLibrary


def lockstep_peer(command: Sequence[str]) -> LockstepPeer:
    """Return the library or the program that a command names; raises ProcessError."""
    return (LockstepLibrary if command[0].endswith(ENDINGS) else LockstepProgram)(command)
