"""The processes of a soak: broker, recorder, plant, controller, babbling node."""

import json
import os
import signal
import subprocess
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Self

from ..runtime.attached import Lifeline

START_TIMEOUT_S = 60.0
STOP_TIMEOUT_S = 60.0
"""How long a process may take to begin, and to write what it has to; a busy machine needs it."""
ABORT_TIMEOUT_S = 5.0
"""How long each may take when the run is given up."""
_AFTER_S = {"recorder": 1.0, "broker": 2.0}
"""By how much these outlast a tool that was ended: they end after those that use them."""
_POLL_S = 0.02
_LISTENING, _READY = "listening at", "ready"


class SoakError(Exception):
    """A process of the soak has failed; the text is one line for the user."""


class Crew:
    """Processes by their names; use it as a context manager, which leaves none behind.

    They end in order with this process too, however that is ended.

    ``folder``   where each writes what it prints (NAME.txt) and its report (NAME.json)
    ``private``  folder of the broker's socket, removed with this process
    ``address``  of the broker
    """

    def __init__(self, folder: Path, private: Path) -> None:
        self._folder = folder
        self._private = private
        self._lifeline = Lifeline()
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        self._asked: set[str] = set()
        self.address = ""

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

    def start_broker(self, socket: Path, options: Sequence[str]) -> None:
        """Start the broker, which listens at ``socket``."""
        self.address = str(socket)
        report = str(self.path("broker", ".json"))
        arguments = ["--address", self.address, "--report", report, *options]
        self._start("broker", "steer_by_wire.runtime.emulated_bus", arguments, _LISTENING)

    def start(self, name: str, module: str, arguments: Sequence[str]) -> None:
        """Start ``python -m module`` and wait until it says that it is ready."""
        self._start(name, module, arguments, _READY)

    def _start(self, name: str, module: str, arguments: Sequence[str], sign: str) -> None:
        printed = self.path(name, ".txt")
        with printed.open("wb") as output:
            process = self._lifeline.start(
                module,
                arguments,
                output,
                after_s=_AFTER_S.get(name, 0.0),
                remove=self._private if name == "broker" else None,
            )
        self._processes[name] = process
        until_s = time.monotonic() + START_TIMEOUT_S
        while sign not in printed.read_text(encoding="utf-8", errors="replace"):
            if process.poll() is not None or time.monotonic() > until_s:
                raise SoakError(f"{name} does not start: {self._last_line(name)}")
            time.sleep(_POLL_S)

    def check(self) -> None:
        """Raise SoakError when one has ended."""
        for name, process in self._processes.items():
            if process.poll() is not None:
                raise SoakError(
                    f"{name} has ended with status {process.returncode}: {self._last_line(name)}"
                )

    def pids(self) -> dict[str, int]:
        """Return every process that runs, with those that they have started themselves."""
        found = {}
        for name, process in self._processes.items():
            found[name] = process.pid
            for number, child in enumerate(children_of(process.pid), start=1):
                found[f"{name}: file writer" + f" {number}" * (number > 1)] = child
        return found

    def kill(self, names: Sequence[str]) -> None:
        """End some that would not end in order."""
        for name in names:
            process = self._processes.pop(name)
            process.kill()
            process.wait()

    def stop(self, name: str) -> dict[str, Any]:
        """End one in order; returns its report. Raises SoakError when it fails to."""
        status = self.end(name)
        if status:
            raise SoakError(f"{name} has ended with status {status}: {self._last_line(name)}")
        report: dict[str, Any] = json.loads(self.path(name, ".json").read_text(encoding="utf-8"))
        return report

    def interrupt(self, name: str) -> None:
        """Ask one to end in order, once: a second SIGINT may hit it when it has let go of them."""
        if name not in self._asked:
            self._asked.add(name)
            self._processes[name].send_signal(signal.SIGINT)

    def end(self, name: str) -> int:
        """End one in order, if it has not ended; returns its exit status, -9 for SIGKILL.

        Raises SoakError when it does not end.
        """
        self.interrupt(name)
        process = self._processes.pop(name)
        try:
            return process.wait(STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            raise SoakError(f"{name} does not end") from None

    def _last_line(self, name: str) -> str:
        printed = self.path(name, ".txt").read_text(encoding="utf-8", errors="replace")
        return (printed.strip().splitlines() or ["it printed nothing"])[-1]


def children_of(pid: int) -> list[int]:
    """Return the processes that a process has started and that still run. Linux only."""
    children = []
    for entry in os.listdir("/proc"):
        if not entry.isdecimal():
            continue
        try:
            stat = Path(f"/proc/{entry}/stat").read_text(encoding="ascii", errors="replace")
        except OSError:
            continue
        if int(stat.rpartition(")")[2].split()[1]) == pid:
            children.append(int(entry))
    return children
