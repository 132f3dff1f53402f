"""The one way to start plant emulator and controller as two processes on a bus."""

import json
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, suppress
from typing import Any, NamedTuple, Self

from ..processes.process_group import ProcessError, Processes
from .bus_recorder import BusRecorder
from .live_bus import Bus
from .pair_result import CONTROLLER_PROGRAM, PLANT_PROGRAM, PairFiles, PairResult, Trace

PROGRAMS = (CONTROLLER_PROGRAM, PLANT_PROGRAM)
"""In the order in which they are started and ended: without a plant the controller would hold."""
_NO_OPTIONS: Mapping[str, Sequence[str]] = {}


class Program(NamedTuple):
    """What ``python -m module words...`` starts."""

    module: str
    words: Sequence[str]


class LivePair:
    """Plant emulator and controller on one bus, with a recorder; use it as a context manager.

        with LivePair(bus, files) as pair:  # with the settings that are in ``files``
            while pair.plant_is_running:
                time.sleep(0.1)
        result = pair.result()

    ``controller``   another program in place of our controller, which gets these words alone and
                     is started when the plant is ready
    ``options``      further options of our programs: {PLANT_PROGRAM: ["--priority", "50"]}
    ``is_recorded``  whether all on the bus is recorded, and the plant leaves its trace

    ``programs``  the processes by name: to signal, kill or end before the other

    Leaving the block ends both with SIGINT, so that their reports are written however the block
    ended, and kills one that does not end. They also end cleanly when this process ends, in
    whatever way. Its own recording then ends with the last frame that was written.
    """

    def __init__(
        self,
        bus: Bus,
        files: PairFiles,
        *,
        controller: Program | None = None,
        options: Mapping[str, Sequence[str]] = _NO_OPTIONS,
        is_recorded: bool = True,
    ) -> None:
        """Start nothing yet."""
        self._files = files
        self._has_own_controller = controller is not None
        self._recorder = BusRecorder(bus, files.candump_log) if is_recorded else None
        self._started = {}
        for program in PROGRAMS:
            # Settings first: after --bus-kwargs they would be parsed as more of its arguments.
            words = [str(files.settings(program)), "--json", str(files.report(program))]
            if program == PLANT_PROGRAM and is_recorded:
                words += ["--trace", str(files.plant_trace)]
            words += [*options.get(program, ()), *bus.options]
            self._started[program] = Program(f"steer_by_wire.{program}", words)
        if controller is not None:
            self._started[CONTROLLER_PROGRAM] = controller
        self._end = ExitStack()

    def __enter__(self) -> Self:
        self._files.folder.mkdir(parents=True, exist_ok=True)
        with ExitStack() as stack:  # the recorder ends last, so that it sees the last frame
            if self._recorder is not None:
                stack.enter_context(self._recorder)
            self.programs = stack.enter_context(Processes(self._files.folder))
            if self._has_own_controller:
                self.programs.start(PLANT_PROGRAM, *self._started[PLANT_PROGRAM])
                self.begin(CONTROLLER_PROGRAM)
            else:
                for program in PROGRAMS:
                    self.begin(program)
            self._end = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        with self._end:
            self.interrupt()
            for program in PROGRAMS:
                with suppress(ProcessError):  # result() raises
                    self.programs.end(program)

    def begin(self, program: str) -> None:
        """Start one of the two again after its end."""
        self.programs.begin(program, *self._started[program])

    def wait_until_ready(self) -> None:
        """Wait until both of our programs run; raises ProcessError when one does not start."""
        for program in PROGRAMS:
            self.programs.wait_until_ready(program)

    def interrupt(self) -> None:
        """Ask both to end without waiting, so that several pairs can end together."""
        for program in PROGRAMS:
            self.programs.interrupt(program)

    @property
    def plant_is_running(self) -> bool:
        """Whether the plant still drives; raises ProcessError when either has failed."""
        if self.programs.status(CONTROLLER_PROGRAM) is not None:
            raise self.programs.failure(CONTROLLER_PROGRAM)
        status = self.programs.status(PLANT_PROGRAM)
        if status:
            raise self.programs.failure(PLANT_PROGRAM)
        return status is None

    @property
    def recording_failure(self) -> str:
        """Why the log ends before the run; empty if it does not."""
        return "" if self._recorder is None else self._recorder.failure

    def report(self, program: str) -> dict[str, Any]:
        """Read the report of one that has ended; raises ProcessError when it has failed."""
        if self.programs.status(program):
            raise self.programs.failure(program)
        report: dict[str, Any] = json.loads(self._files.report(program).read_text("utf-8"))
        return report

    def result(self) -> PairResult:
        """Read what both have written; raises ProcessError when one has failed."""
        controller, plant = (self.report(program) for program in PROGRAMS)
        return PairResult(plant, controller, Trace.read(self._files.plant_trace))
