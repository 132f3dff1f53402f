"""A program of the project that runs while a test looks on."""

import json
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

PATIENCE_S = 300.0
"""How long something that must happen is waited for, on a machine however busy."""
ORDINARY = ("--priority", "0", "--no-memory-lock")
"""Asks the host for nothing, so that a test does not depend on what it grants."""
UNSUPERVISED = (
    "--set",
    'overruns.overruns_max="off"',
    "--set",
    'overruns.missed_periods_max="off"',
)
"""A node of a busy machine misses most of its periods, and would end for that in its safe state."""


class RunningProgram:
    """One process, what it has printed so far, and its report.

    ``printed``  both streams, line by line
    """

    def __init__(self, module: str, options: Sequence[str], report: Path) -> None:
        self._report = report
        self.printed: list[str] = []
        fixed = [*ORDINARY, *UNSUPERVISED, "--json", str(report)]
        self._process = subprocess.Popen(
            [sys.executable, "-m", module, *fixed, *options],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self.printed.append(line.rstrip("\n"))

    @property
    def pid(self) -> int:
        """The process's number."""
        return self._process.pid

    def wait_for(self, pattern: str, skip: int = 0) -> str:
        """Wait for a line to be printed behind the first ``skip``; returns it."""

        def found() -> str | None:
            return next((line for line in self.printed[skip:] if re.search(pattern, line)), None)

        wait_until(lambda: found() is not None or not self._reader.is_alive(), pattern)
        line = found()
        assert line is not None, f"it ended without {pattern!r}: {self.printed}"
        return line

    def interrupt(self) -> int:
        """End it as Ctrl-C does; returns its exit status."""
        self._process.send_signal(signal.SIGINT)
        return self.end()

    def end(self) -> int:
        """Wait for its end; returns its exit status."""
        status = self._process.wait(PATIENCE_S)
        self._reader.join(PATIENCE_S)
        return status

    def kill(self) -> None:
        """Leave nothing behind."""
        self._process.kill()
        self.end()
        assert self._process.stdout is not None
        self._process.stdout.close()

    def report(self) -> dict[str, Any]:
        """Read what it has reported."""
        report: dict[str, Any] = json.loads(self._report.read_text(encoding="utf-8"))
        return report


@contextmanager
def running(module: str, options: Sequence[str], report: Path) -> Iterator[RunningProgram]:
    """Run a program until the end of the block."""
    program = RunningProgram(module, options, report)
    try:
        program.wait_for("ready on|error:")
        yield program
    finally:
        program.kill()


def wait_until(condition: Callable[[], bool], what: str) -> None:
    """Wait for something that must happen; look the less often, the longer it takes."""
    start_s = time.monotonic()
    while not condition():
        waited_s = time.monotonic() - start_s
        assert waited_s < PATIENCE_S, f"this does not come: {what}"
        time.sleep(min(0.005 + 0.05 * waited_s, 0.1))
