"""Plant emulator and controller as two processes on one channel, with a recorder listening in."""

import json
import signal
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple, Self

import can

from ..runtime.attached import Lifeline
from ..runtime.bus import BusError
from .trace import Trace

STOP_TIMEOUT_S = 60.0
"""How long a program may take to write its report; a busy machine needs it."""


class PairError(BusError):
    """A program of the pair failed; the text is one line for the user."""


class PairFiles(NamedTuple):
    """Where one pair leaves its results."""

    folder: Path

    @property
    def candump_log(self) -> Path:
        """Every frame on the channel, as ``candump -L`` prints it."""
        return self.folder / "candump.log"

    @property
    def plant_trace(self) -> Path:
        """The plant's samples, CSV."""
        return self.folder / "plant_trace.csv"

    def settings(self, program: str) -> Path:
        """The settings one program is run with, TOML."""
        return self.folder / f"{program}.toml"

    def report(self, program: str) -> Path:
        """The report of one program, JSON."""
        return self.folder / f"{program}.json"

    def output(self, program: str) -> Path:
        """What one program printed."""
        return self.folder / f"{program}.txt"


class PairResult(NamedTuple):
    """What one run of a pair left: the two reports and the plant's time histories."""

    plant: dict[str, Any]
    controller: dict[str, Any]
    trace: Trace


class Bus(NamedTuple):
    """How programs and recorder join one channel: python-can's interface, channel and arguments."""

    interface: str
    channel: str
    arguments: dict[str, str]

    @property
    def options(self) -> list[str]:
        """The same as python-can's command line options."""
        options = ["--interface", self.interface, "--channel", self.channel]
        if self.arguments:
            options += ["--bus-kwargs", *(f"{k}={v}" for k, v in self.arguments.items())]
        return options

    def open(self) -> can.BusABC:
        """Join the channel; raises what python-can raises."""
        arguments: dict[str, Any] = dict(self.arguments)
        return can.Bus(interface=self.interface, channel=self.channel, **arguments)


class LivePair:
    """Two running programs and their recorder; use it as a context manager.

    Leaving the block ends the programs with SIGINT, so that their reports are written whatever
    ended the block, and kills what does not end. They end in order with this process too, however
    that is ended; what it records itself is then as far as it was written.
    """

    def __init__(
        self,
        bus: Bus,
        plant_options: Sequence[str],
        controller_options: Sequence[str],
        files: PairFiles,
    ) -> None:
        self._bus = bus
        self._options = {
            "controller": list(controller_options),
            "plant_emulator": ["--trace", str(files.plant_trace), *plant_options],
        }
        self._files = files
        self._processes: dict[str, subprocess.Popen[bytes]] = {}
        self._lifeline: Lifeline | None = None
        self._listener: can.BusABC | None = None
        self._recorder: can.Notifier | None = None

    def __enter__(self) -> Self:
        self._files.folder.mkdir(parents=True, exist_ok=True)
        listener = self._bus.open()
        writer = can.CanutilsLogWriter(self._files.candump_log, channel=self._bus.channel)
        self._listener, self._recorder = listener, can.Notifier(listener, [writer])
        self._lifeline = line = Lifeline()
        try:
            for program in self._options:
                self._processes[program] = self._start(program, line)
        except BaseException:
            self.stop()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    @property
    def plant_is_running(self) -> bool:
        """Whether the plant still drives; raises PairError when the controller has died first."""
        code = self._processes["controller"].poll()
        if code is not None:
            raise PairError(self._complaint("controller", code))
        code = self._processes["plant_emulator"].poll()
        if code:
            raise PairError(self._complaint("plant_emulator", code))
        return code is None

    def stop(self) -> None:
        """End what runs; the recorder last, so that it sees the last frame."""
        for process in self._processes.values():
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
        for process in self._processes.values():
            try:
                process.wait(STOP_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        if self._lifeline is not None:
            self._lifeline.close()
            self._lifeline = None
        if self._recorder is not None:
            self._recorder.stop()
            self._recorder = None
        if self._listener is not None:
            self._listener.shutdown()
            self._listener = None

    def result(self) -> PairResult:
        """Read what the programs have written; raises PairError when a report is missing."""
        for program, process in self._processes.items():
            if process.returncode:
                raise PairError(self._complaint(program, process.returncode))
        return PairResult(
            json.loads(self._files.report("plant_emulator").read_text(encoding="utf-8")),
            json.loads(self._files.report("controller").read_text(encoding="utf-8")),
            Trace.read(self._files.plant_trace),
        )

    def _start(self, program: str, line: Lifeline) -> subprocess.Popen[bytes]:
        report = str(self._files.report(program))
        arguments = [*self._bus.options, "--report", report, *self._options[program]]
        with self._files.output(program).open("wb") as output:
            return line.start(program, arguments, output)

    def _complaint(self, program: str, code: int) -> str:
        printed = self._files.output(program).read_text(encoding="utf-8", errors="replace")
        last = (printed.strip().splitlines() or ["it printed nothing"])[-1]
        return f"{program} ended with status {code}: {last}"
