"""Processes that run together and end with this one: bus, plant, controller and others."""

import errno
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO, Self

from ...runtime.exit_status import BusError, printable

START_TIMEOUT_S = 60.0
STOP_TIMEOUT_S = 60.0
"""How long a process may take to start, and to write its results; long, for a busy machine."""
ABORT_TIMEOUT_S = 5.0
"""How long each may take when the run is given up."""
BROKER_AFTER_S = 1.0
"""How long a launched broker outlives a killed parent, so that its clients end first."""
_POLL_S = 0.02
_READY = "ready"
_ENDS_WITH_PARENT = "steer_by_wire.closed_loop.processes.ends_with_parent"


class ProcessError(BusError):
    """A process has failed; the text is one line for the user."""


class Lifeline:
    """A pipe that children wait on and whose other end only this process holds."""

    def __init__(self) -> None:
        # A child inherits neither end, except as its standard input.
        self._waiting, self._held = os.pipe()

    def start(
        self,
        module: str,
        arguments: Sequence[str],
        output: IO[bytes] | int,
        errors: IO[bytes] | IO[str] | int | None = subprocess.STDOUT,
        *,
        after_s: float = 0.0,
        remove: Path | None = None,
    ) -> subprocess.Popen[bytes]:
        """Start ``python -m module`` in a session of its own, so that Ctrl-C reaches only us.

        ``after_s``  how long after this process the child ends
        ``remove``   folder that the child then removes
        """
        program = [sys.executable, "-P", "-m", _ENDS_WITH_PARENT]
        options = ["--after", str(after_s)] + ([] if remove is None else ["--remove", str(remove)])
        return subprocess.Popen(  # noqa: S603 the command is our own
            [*program, *options, module, *arguments],
            stdin=self._waiting,
            stdout=output,
            stderr=errors,
            start_new_session=True,
        )

    def close(self) -> None:
        """Close the pipe, which ends the children that still run."""
        os.close(self._held)
        os.close(self._waiting)


_FREE_MIN = 1 << 12
"""Less than that is a full disk [bytes]."""


class Processes:
    """Processes by their names; use it as a context manager, which leaves none behind.

    They also end cleanly when this process ends, however it does.

    ``folder``  where each writes what it prints (NAME.txt) and its report (NAME.json)
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._lifeline = Lifeline()
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        self._asked: set[str] = set()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        try:
            for name, process in reversed(self._processes.items()):
                if process.poll() is None:
                    self.interrupt(name)
                    with suppress(subprocess.TimeoutExpired):
                        process.wait(ABORT_TIMEOUT_S)
                    process.kill()
                    process.wait()
        finally:
            self._lifeline.close()

    def path(self, name: str, suffix: str) -> Path:
        """Return the file of a process."""
        return self._folder / f"{name}{suffix}"

    def start(self, name: str, module: str, arguments: Sequence[str]) -> None:
        """Start ``python -m module`` and wait until it reports that it is ready."""
        self.begin(name, module, arguments)
        self.wait_until_ready(name)

    def wait_until_ready(self, name: str) -> None:
        """Wait until one reports that it is ready; raises ProcessError when it does not start."""
        until_s = time.monotonic() + START_TIMEOUT_S
        while _READY not in self._printed(name):
            self._refuse_full_disk()
            if self.status(name) is not None or time.monotonic() > until_s:
                raise ProcessError(f"{name} does not start: {self._last_line(name)}")
            time.sleep(_POLL_S)

    def begin(self, name: str, module: str, arguments: Sequence[str]) -> None:
        """Start ``python -m module`` without waiting for it."""
        self._asked.discard(name)
        with self.path(name, ".txt").open("wb") as output:
            self._processes[name] = self._lifeline.start(module, arguments, output)

    def status(self, name: str) -> int | None:
        """Return the exit status of one, None while it runs."""
        return self._processes[name].poll()

    def failure(self, name: str) -> ProcessError:
        """Return the error to raise when one has ended too early, or with an error."""
        self._refuse_full_disk()
        return ProcessError(
            f"{name} has ended with status {self.status(name)}: {self._last_line(name)}"
        )

    def kill(self, name: str) -> None:
        """Kill one with SIGKILL."""
        self._processes[name].kill()
        self._processes[name].wait()

    def signal(self, name: str, number: int) -> None:
        """Send a signal to one, if it still runs."""
        self._processes[name].send_signal(number)

    def interrupt(self, name: str) -> None:
        """Send SIGINT, once: a second one may come when the handler has been removed."""
        if name not in self._asked:
            self._asked.add(name)
            self._processes[name].send_signal(signal.SIGINT)

    def end(self, name: str) -> int:
        """End one cleanly, if it still runs; returns its exit status, -9 after SIGKILL.

        Raises ProcessError when it does not end.
        """
        self.interrupt(name)
        try:
            return self._processes[name].wait(STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self.kill(name)
            raise ProcessError(f"{name} does not end") from None

    def _refuse_full_disk(self) -> None:
        """Raise OSError where a program could not write what it has to say."""
        if shutil.disk_usage(self._folder).free < _FREE_MIN:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(self._folder))

    def _last_line(self, name: str) -> str:
        lines = self._printed(name).strip().splitlines()
        # python-can says this of any program that crashed, after the exception.
        said = [line for line in lines if not line.endswith("was not properly shut down")]
        return printable((said or ["it printed nothing"])[-1])

    def _printed(self, name: str) -> str:
        return self.path(name, ".txt").read_text(encoding="utf-8", errors="replace")


@contextmanager
def launched_broker(options: Sequence[str] = (), log: IO[str] | None = None) -> Iterator[str]:
    """Run a broker with command line ``options`` until the end of the block.

    ``log``  for its statistics and messages; standard error unless given

    Yields its address, a socket in a private directory, when clients can connect. Broker and
    directory go with this process, however that ends. Raises RuntimeError if the broker does not
    start, after it has printed the reason on standard error.
    """
    made = TemporaryDirectory(prefix="steer-by-wire-bus-", ignore_cleanup_errors=True)
    with made as folder, closing(Lifeline()) as line:
        address = str(Path(folder) / "socket")
        arguments = ["--address", address, *options]
        broker = line.start(
            "steer_by_wire.tools.bus",
            arguments,
            subprocess.PIPE,
            log,
            after_s=BROKER_AFTER_S,
            remove=Path(folder),
        )
        with broker:  # ends with waiting for it
            if broker.stdout is None or not broker.stdout.readline():
                raise RuntimeError("the broker of the emulated bus has not started")
            try:
                yield address
            finally:
                broker.terminate()
