"""One run of real processes: a pair and a recorder on an emulated bus, and what disturbs them."""

import json
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from ....closed_loop.pair.bus_recorder import BusRecorder
from ....closed_loop.pair.live_bus import Bus
from ....closed_loop.pair.live_pair import LivePair
from ....closed_loop.pair.pair_result import CONTROLLER_PROGRAM, PLANT_PROGRAM, PairFiles
from ....closed_loop.processes.private_folder import private_folder
from ....closed_loop.processes.process_group import Processes
from ....controller.settings import controller_preset
from ....plant_emulator.settings import PlantSettings

CHANNEL = "can0"
BROKER = "broker"
DURATION_S = 86_400.0
"""Of the plant's motion: the pair runs until it is ended."""
GONE_TIMEOUT_S = 5.0
"""Time that the file-writing processes of the programs may need to end after them."""


class LiveSetup(NamedTuple):
    """How a pair is started.

    ``broker``   options of the broker
    ``both``     options of both nodes
    ``plant``    settings of the plant
    ``takes_fd`` whether the bus carries CAN FD frames
    """

    broker: Sequence[str] = ()
    both: Sequence[str] = ()
    plant: PlantSettings = PlantSettings(duration_s=DURATION_S)
    takes_fd: bool = False


class Running(NamedTuple):
    """A pair that runs, and ``others``: the broker, and what a run adds to it."""

    pair: LivePair
    others: Processes

    @property
    def bus(self) -> Bus:
        """How a further program joins the bus."""
        return Bus("emulated", CHANNEL, {"address": self.others.address})

    def pids(self) -> dict[str, int]:
        """Return every process of the run by its name."""
        return {**self.others.pids(), **self.pair.programs.pids()}


class LiveRun(NamedTuple):
    """Files and figures of a run.

    ``statuses``   exit status by process; -9 for SIGKILL
    ``reports``    of the programs that have written one
    ``left``       processes and files that should have gone
    ``cut_off``  why the recording of the bus ends before the run, empty if it does not
    """

    folder: Path
    statuses: Mapping[str, int]
    reports: Mapping[str, Any]
    left: Sequence[str] = ()
    cut_off: str = ""

    @property
    def bus_log(self) -> Path:
        """Everything that was on the bus, with its time stamps."""
        return PairFiles(self.folder).candump_log

    def own_log(self, program: str) -> Path:
        """Frames that one program sent and received."""
        return self.folder / f"{program}.log"


def run_live(
    folder: Path, setup: LiveSetup, disturb: Callable[[Running], Sequence[str]]
) -> LiveRun:
    """Start broker, recorder, plant and controller, disturb them, and end them again.

    ``disturb``  starts what is to disturb the pair, and returns its names when the time is over

    Raises ProcessError when a process does not start or does not end.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.iterdir():
        if old.suffix in (".log", ".json", ".txt"):
            old.unlink()
    files = PairFiles(folder)
    files.write_settings(setup.plant, controller_preset("practical_pd_ddob"))
    options = {
        name: [*setup.both, "--record", str(folder / f"{name}.log")]
        for name in (PLANT_PROGRAM, CONTROLLER_PROGRAM)
    }
    with private_folder("faults") as private:
        socket = private / "socket"
        with Processes(folder, private) as others:
            others.start_broker(socket, setup.broker)
            bus = Bus("emulated", CHANNEL, {"address": others.address})
            all_formats = {"fd": "True"} if setup.takes_fd else {}
            recorded = bus._replace(arguments={**bus.arguments, **all_formats})
            with (
                BusRecorder(recorded, files.candump_log) as recorder,
                LivePair(bus, files, options=options, is_recorded=False) as pair,
            ):
                pair.wait_until_ready()
                running = Running(pair, others)
                further = disturb(running)
                pids = running.pids()
                statuses = {name: others.end(name) for name in further}
                # Both together: either would enter its hold if the other ended first.
                pair.interrupt()
                statuses |= {
                    name: pair.programs.end(name) for name in (CONTROLLER_PROGRAM, PLANT_PROGRAM)
                }
            statuses[BROKER] = others.end(BROKER)
        left = _still_there(pids)
        left += [socket.name] if socket.exists() else []
    reports = {}
    for name in statuses:
        with suppress(FileNotFoundError):  # a killed program writes none
            reports[name] = json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))
    return LiveRun(folder, statuses, reports, left, recorder.failure)


def _still_there(pids: Mapping[str, int]) -> list[str]:
    """Return which processes still exist after a while."""
    until_s = time.monotonic() + GONE_TIMEOUT_S
    while True:
        left = [f"process {name}" for name, pid in pids.items() if Path(f"/proc/{pid}").exists()]
        if not left or time.monotonic() > until_s:
            return left
        time.sleep(0.05)
