"""The pairs that the cockpit itself runs: bus, plants, controllers, and a lane for each.

With what a page draws beside the signals: the vehicle to scale and the path it is to follow.
"""

import signal
import tempfile
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path as FilePath
from typing import Literal, NamedTuple

from ...closed_loop.channels import open_channels
from ...closed_loop.live import Bus
from ...closed_loop.processes import Processes
from ...closed_loop.virtual import QUIET_BUS
from ...plant_emulator.path.path import Path, pose
from ...plant_emulator.path.shapes import build_path
from ...plant_emulator.settings import PlantSettings
from ...plant_emulator.vehicle.rig_settings import VehicleSettings
from ...runtime.bus_model.settings import BusSettings
from ...runtime.port.python_can import BusPort
from ...runtime.settings.toml_text import dump_toml
from .lane import Lane
from .scenario import LaneSettings, Scenario, lane_settings

_POINT_M = 0.5
_OPEN_END_M = 400.0
"""How much of an open path is drawn."""
_POINTS_MAX = 4000


class LaneFacts(NamedTuple):
    """One lane, ready for JSON.

    ``path_m``  points (x, y) of the path, empty where it is not known
    """

    label: str
    front_axle_m: float
    rear_axle_m: float
    preview_m: float
    path_m: Sequence[tuple[float, float]]
    path_is_closed: bool


def lane_facts(label: str, plant: PlantSettings | None = None) -> LaneFacts:
    """Return the facts of a lane; without ``plant``, of a bus that somebody else drives.

    Its vehicle is then that of the wire contract.
    """
    vehicle = VehicleSettings() if plant is None else plant.vehicle
    path = None if plant is None else build_path(plant.path)
    return LaneFacts(
        label,
        vehicle.front_axle_distance_m,
        vehicle.rear_axle_distance_m,
        vehicle.preview_distance_m,
        () if path is None else _points(path),
        path is not None and path.closed,
    )


def _points(path: Path) -> Sequence[tuple[float, float]]:
    length_m = path.length_m if path.closed else path.length_m + _OPEN_END_M
    count = min(round(length_m / _POINT_M), _POINTS_MAX)
    places = (pose(path, length_m * number / count) for number in range(count + 1))
    return [(round(place.x_m, 3), round(place.y_m, 3)) for place in places]


Action = Literal["kill", "pause", "resume", "restart"]
Program = Literal["plant", "controller"]
_MODULES: Mapping[Program, str] = {
    "plant": "steer_by_wire.plant_emulator",
    "controller": "steer_by_wire.controller",
}


class Rig:
    """Runs one scenario after the other; its methods may take seconds.

    ``wanted``    bus: auto, socketcan or emulated, as ``open_channels`` takes it
    ``settings``  of an emulated bus

    ``lanes``, ``facts``  one a pair
    ``bus``               description of the bus
    """

    def __init__(self, wanted: str, settings: BusSettings = QUIET_BUS) -> None:
        self._wanted, self._settings = wanted, settings
        self._stack = ExitStack()
        self._processes: Processes | None = None
        self._arguments: dict[str, tuple[str, Sequence[str]]] = {}
        self._paused: set[str] = set()
        self.lanes: Sequence[Lane] = ()
        self.facts: Sequence[LaneFacts] = ()
        self.bus = ""

    def start(self, scenario: Scenario) -> None:
        """Start a scenario anew; raises SettingsError, BusError or OSError."""
        settings = lane_settings(scenario)
        self.stop()
        with ExitStack() as stack:
            private = tempfile.TemporaryDirectory(prefix="steer-by-wire-cockpit-")
            folder = FilePath(stack.enter_context(private))
            names = [f"lane{number}" for number in range(1, len(settings) + 1)]
            seed = settings[0].plant.seed
            channels = stack.enter_context(
                open_channels(self._wanted, names, folder / "bus.txt", self._settings, seed)
            )
            self._processes = stack.enter_context(Processes(folder))
            self._arguments = {}
            lanes = []
            for number, (bus, lane) in enumerate(zip(channels.buses, settings, strict=True)):
                path = build_path(lane.plant.path)
                lanes.append(Lane(BusPort(bus.open()), time.monotonic_ns(), path))
                stack.callback(lanes[-1].close)
                self._begin_pair(folder, number, bus, lane)
            self._stack = stack.pop_all()
        self.lanes, self.facts = lanes, [lane_facts(lane.label, lane.plant) for lane in settings]
        self.bus = channels.description

    def stop(self) -> None:
        """End all processes and the bus, and close the lanes."""
        self.lanes = ()
        if self._processes is not None:
            for name in self._arguments:
                self._processes.signal(name, signal.SIGCONT)
                if self._processes.status(name) is None:
                    self._processes.interrupt(name)
        self._processes = None
        self._paused.clear()
        self._stack.close()

    def act(self, lane: int, program: Program, action: Action) -> None:
        """Kill, pause, resume or restart one process; nothing where that makes no sense."""
        name = _name(program, lane)
        if self._processes is None or name not in self._arguments:
            return
        if action == "restart":
            if self._processes.status(name) is not None:
                self._processes.begin(name, *self._arguments[name])
                if program == "plant":
                    self.lanes[lane].on_plant_start()
            return
        number = {"kill": signal.SIGKILL, "pause": signal.SIGSTOP, "resume": signal.SIGCONT}
        self._processes.signal(name, number[action])
        (self._paused.add if action == "pause" else self._paused.discard)(name)

    def states(self) -> Sequence[Mapping[Program, str]]:
        """Return what the programs of each lane do: running, paused, or ended."""
        return [
            {program: self._state(_name(program, lane)) for program in _MODULES}
            for lane in range(len(self.lanes))
        ]

    def _begin_pair(self, folder: FilePath, lane: int, bus: Bus, settings: LaneSettings) -> None:
        of_program = {"plant": settings.plant, "controller": settings.controller}
        for program, module in _MODULES.items():
            name = _name(program, lane)
            file = folder / f"{name}.toml"
            file.write_text(dump_toml(of_program[program]), encoding="utf-8")
            self._arguments[name] = (module, [str(file), *bus.options])
            if self._processes is not None:
                self._processes.begin(name, *self._arguments[name])

    def _state(self, name: str) -> str:
        if self._processes is None:
            return "ended"
        status = self._processes.status(name)
        if status is not None:
            return f"ended, status {status}"
        return "paused" if name in self._paused else "running"


def _name(program: Program, lane: int) -> str:
    return f"{program}-{lane + 1}"
