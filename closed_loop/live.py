"""Plant emulator and controller as two processes on one channel, with a recorder listening in."""

import json
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, NamedTuple, Self

import can

from ..controller.settings import ControllerSettings
from ..plant_emulator.settings import PlantSettings
from ..runtime.settings.toml_text import dump_toml
from .processes import ProcessError, Processes
from .result import Trace


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

    def write_settings(self, plant: PlantSettings, controller: ControllerSettings) -> None:
        """Write the settings of both programs; makes the folder."""
        self.folder.mkdir(parents=True, exist_ok=True)
        self.settings("plant_emulator").write_text(dump_toml(plant), encoding="utf-8")
        self.settings("controller").write_text(dump_toml(controller), encoding="utf-8")

    def report(self, program: str) -> Path:
        """The report of one program, JSON."""
        return self.folder / f"{program}.json"


class PairResult(NamedTuple):
    """Results of one run of a pair: the two reports and the plant's time histories."""

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


class _Recorder:
    """Writes every frame of a bus, in a thread.

    ``failure``  why the log ends early; a bus drops a recorder that reads too slowly
    """

    def __init__(self, bus: can.BusABC, writer: can.Listener) -> None:
        self.failure = ""
        self._writer = writer
        self._notifier = can.Notifier([], [self])
        self._notifier.add_bus(bus)  # its thread may fail at once

    def __call__(self, message: can.Message) -> None:
        """Write a frame."""
        self._writer(message)

    def on_error(self, error: Exception) -> None:
        """End the recording; the pair itself runs on."""
        self.failure = str(error)
        self._notifier.stop(0.0)

    def end(self) -> None:
        """End the recording and close the log."""
        self._notifier.stop()
        self._writer.stop()


class LivePair:
    """Two running programs and their recorder; use it as a context manager.

    Leaving the block ends the programs with SIGINT, so that their reports are written however the
    block ended, and kills those that do not end. They also end cleanly when this process ends, in
    whatever way. Its own recording then ends with the last frame that was written.
    """

    def __init__(self, bus: Bus, files: PairFiles) -> None:
        """Each program takes its settings from ``files``."""
        self._bus = bus
        self._options = {
            "controller": [],
            "plant_emulator": ["--trace", str(files.plant_trace)],
        }
        self._files = files
        self._end = ExitStack()

    def __enter__(self) -> Self:
        self._files.folder.mkdir(parents=True, exist_ok=True)
        with ExitStack() as stack:  # the recorder ends last, so that it sees the last frame
            listener = self._bus.open()
            stack.callback(listener.shutdown)
            writer = can.CanutilsLogWriter(self._files.candump_log, channel=self._bus.channel)
            self._recorder = _Recorder(listener, writer)
            stack.callback(self._recorder.end)
            self._programs = stack.enter_context(Processes(self._files.folder))
            for program, options in self._options.items():
                report, settings = self._files.report(program), self._files.settings(program)
                arguments = [*self._bus.options, "--report", str(report), *options, str(settings)]
                self._programs.begin(program, f"steer_by_wire.{program}", arguments)
            self._end = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        with self._end:
            for program in self._options:
                self._programs.interrupt(program)
            for program in self._options:
                with suppress(ProcessError):  # result() raises
                    self._programs.end(program)

    @property
    def plant_is_running(self) -> bool:
        """Whether the plant still drives; raises ProcessError when either has failed."""
        if self._programs.status("controller") is not None:
            raise self._programs.failure("controller")
        status = self._programs.status("plant_emulator")
        if status:
            raise self._programs.failure("plant_emulator")
        return status is None

    @property
    def recording_failure(self) -> str:
        """Why the log ends before the run; empty if it does not."""
        return self._recorder.failure

    def result(self) -> PairResult:
        """Read what the programs have written; raises ProcessError when one has failed."""
        for program in self._options:
            if self._programs.status(program):
                raise self._programs.failure(program)
        return PairResult(
            json.loads(self._files.report("plant_emulator").read_text(encoding="utf-8")),
            json.loads(self._files.report("controller").read_text(encoding="utf-8")),
            Trace.read(self._files.plant_trace),
        )
