"""A program or a shared library that speaks the lockstep protocol.

A program does so on its standard input and output. A library does within this process: nothing
waits for pipes, but what crashes or hangs in it ends or holds up this process.
"""

import _ctypes
import ctypes
import os
import select
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, Self, cast

from ...runtime.exit_status import printable
from ...runtime.settings import SettingsError
from ..processes.process_group import ProcessError
from .record import RECORD_BYTES, Record, RecordError, check_mark, pack, unpack

ANSWER_TIMEOUT_S = 30.0
"""How long a program may compute one answer, in real time: long, for a busy machine."""
END_TIMEOUT_S = 3.0
"""How long it may take to end once its input has ended."""


class LockstepProgram:
    """A running program; use it as a context manager, which leaves none of its processes behind.

    ``name``, ``pid``  of the program; its process group has the same number

    Raises ProcessError when the program cannot be started.
    """

    def __init__(self, command: Sequence[str]) -> None:
        self.name = os.path.basename(command[0])
        self._errors = tempfile.TemporaryFile()  # noqa: SIM115 closed in __exit__
        try:
            self._process = subprocess.Popen(  # noqa: S603 the user's own command
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._errors,
                bufsize=0, start_new_session=True,
            )  # fmt: skip
        except OSError as error:
            self._errors.close()
            raise ProcessError(f"{command[0]}: {error.strerror}") from error
        self.pid = self._process.pid
        self._input = cast(IO[bytes], self._process.stdin)
        self._output = cast(IO[bytes], self._process.stdout)
        os.set_blocking(self._input.fileno(), False)
        self._writable, self._readable = select.poll(), select.poll()
        self._writable.register(self._input, select.POLLOUT)
        self._readable.register(self._output, select.POLLIN)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._output.close()
        self._input.close()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(END_TIMEOUT_S)
        with suppress(ProcessLookupError):
            os.killpg(self.pid, signal.SIGKILL)
        self._process.wait()
        self._errors.close()

    def exchange(self, record: Record) -> Record:
        """Send a record; returns the answer. Raises ProcessError when there is none to use."""
        self._send(pack(record))
        answer = self._more(0)
        try:
            while len(answer) < RECORD_BYTES:
                check_mark(answer)
                answer += self._more(len(answer))
            return unpack(answer)
        except RecordError as error:
            raise ProcessError(f"{self.name}: its standard output: {error}") from error

    def _send(self, packed: bytes) -> None:
        """Write a record, which a pipe takes whole or not at all."""
        try:
            if self._input.write(packed) is not None:
                return
            if self._writable.poll(1e3 * ANSWER_TIMEOUT_S):
                self._input.write(packed)
                return
        except BrokenPipeError:
            return  # what it has printed, or how it has ended, says more
        raise ProcessError(
            f"{self.name}: has not read its standard input within {ANSWER_TIMEOUT_S:g} s"
        )

    def _more(self, received: int) -> bytes:
        """Return at least one byte of an answer of which so many have been received."""
        if not self._readable.poll(1e3 * ANSWER_TIMEOUT_S):
            got = f"{received} of {RECORD_BYTES} bytes of an answer"
            raise ProcessError(f"{self.name}: {got} within {ANSWER_TIMEOUT_S:g} s")
        if part := self._output.read(RECORD_BYTES - received):
            return part
        raise ProcessError(self._ended(received))

    def _ended(self, received: int) -> str:
        """Return in words how it ended; it may take a moment after it has closed its output."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(END_TIMEOUT_S)
        status = self._process.returncode
        if status is None:
            how = "has closed its standard output"
        elif status < 0:
            how = f"ended by {signal.Signals(-status).name}"
        else:
            how = f"ended with status {status}"
        inside = f" after {received} of {RECORD_BYTES} bytes of an answer" if received else ""
        self._errors.seek(0)
        lines = self._errors.read().decode(errors="replace").strip().splitlines()
        said = f"; its last line: {printable(lines[-1][:200])}" if lines else ""
        return f"{self.name} {how}{inside}{said}"


ENDINGS = (".so", ".dylib")
FUNCTION = "lockstep_exchange"


class LockstepLibrary:
    """A library loaded for one run; a context manager that unloads it.

    A copy of the file is loaded: its variables are new in every run, also in runs side by side.

    Raises ProcessError when it cannot be loaded, SettingsError for words behind its name.
    """

    def __init__(self, command: Sequence[str]) -> None:
        file = command[0]
        self.name = os.path.basename(file)
        if len(command) > 1:
            raise SettingsError(f"{file}: a shared library takes no words: leave out {command[1]}")
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
        _ctypes.dlclose(self._library._handle)  # not on Windows, where no library ends in .so

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
