"""The pairs that the cockpit itself runs: bus, plants, controllers, and a lane for each.

With what a page draws besides the signals: the vehicle to scale and the path it is to follow.
"""

import signal
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path as FilePath
from tempfile import TemporaryDirectory
from typing import Literal, NamedTuple

from ...closed_loop.pair.live_bus import open_channels
from ...closed_loop.pair.live_pair import LivePair
from ...closed_loop.pair.live_pair import Program as StartedProgram
from ...closed_loop.pair.pair_result import (
    CONTROLLER_PROGRAM,
    HAND_WHEEL_PROGRAM,
    PLANT_PROGRAM,
    PairFiles,
)
from ...closed_loop.pair.virtual_bus import QUIET_BUS
from ...closed_loop.reports.law_colours import LawLine, law_lines
from ...dbc.bus_language import OUR_LANGUAGE, BusLanguage
from ...plant_emulator.path.path import Path, pose
from ...plant_emulator.path.path_from_settings import build_path
from ...plant_emulator.settings import PlantSettings
from ...plant_emulator.vehicle.settings import VehicleSettings
from ...runtime.bus_model.settings import BusSettings
from ...runtime.port.python_can import BusPort
from .ghost import Ghost
from .lane import Lane
from .orders import HandFile
from .scenario import HAND, LaneSettings, Scenario, lane_settings

_POINT_M = 0.5
_OVERHANG_M, _WIDTH_M = 0.85, 1.78
"""Of the body of a vehicle without tyres."""
_OPEN_END_M = 400.0
"""How much of an open path is drawn."""
_POINTS_MAX = 4000


class LaneFacts(NamedTuple):
    """One lane, ready for JSON.

    ``line``    colour and dash of its law
    ``body_m``  from the centre of gravity to its front and to its rear, and its width
    ``mass_kg``  None where it is not known
    ``path_m``  points (x, y) of the path, empty where it is not known
    """

    label: str
    line: LawLine
    mass_kg: float | None
    body_m: tuple[float, float, float]
    front_axle_m: float
    rear_axle_m: float
    preview_m: float
    path_m: Sequence[tuple[float, float]]
    path_is_closed: bool


def lane_facts(label: str, line: LawLine, plant: PlantSettings | None = None) -> LaneFacts:
    """Return the facts of a lane; without ``plant``, of a bus that somebody else drives.

    Its vehicle is then that of the wire contract.
    """
    vehicle = VehicleSettings() if plant is None else plant.vehicle
    car = None if plant is None else plant.car
    axles_m = vehicle.front_axle_distance_m, vehicle.rear_axle_distance_m
    body_m = axles_m[0] + _OVERHANG_M, axles_m[1] + _OVERHANG_M, _WIDTH_M
    path = None if plant is None else build_path(plant.path)
    return LaneFacts(
        label,
        line,
        None if plant is None else vehicle.virtual_mass_kg,
        body_m if car is None else (car.front_m, car.rear_m, car.width_m),
        *axles_m,
        vehicle.preview_distance_m,
        () if path is None else _points(path),
        path is not None and path.closed,
    )


def _points(path: Path) -> Sequence[tuple[float, float]]:
    length_m = path.length_m if path.closed else path.length_m + _OPEN_END_M
    count = min(round(length_m / _POINT_M), _POINTS_MAX)
    places = (pose(path, length_m * number / count) for number in range(count + 1))
    return [(round(place.x_m, 3), round(place.y_m, 3)) for place in places]


def _line_of(lane: LaneSettings) -> str:
    """Return the law whose colour a lane has; a feedback law has that of its kind."""
    if lane.hand_wheel is not None:
        return "pd_cdob" if lane.hand_wheel.feedback.law == "cdob" else "pd"
    return lane.controller.law if lane.controller else HAND


Action = Literal["kill", "pause", "resume", "restart", "put_back"]
Program = Literal["plant", "controller"]
_PROGRAMS: Mapping[Program, str] = {"plant": PLANT_PROGRAM, "controller": CONTROLLER_PROGRAM}


class OwnLanes:
    """Runs one scenario after the other; its methods may take seconds.

    ``wanted``    bus: auto, socketcan or emulated, as ``open_channels`` takes it
    ``settings``  of an emulated bus
    ``usb_wheel`` device in the visitor's hands, in the first lane with a hand wheel

    ``lanes``, ``facts``  one a pair
    ``hand``              where the visitor's angle goes; None where no one can steer
    """

    def __init__(
        self,
        wanted: str,
        settings: BusSettings = QUIET_BUS,
        language: BusLanguage = OUR_LANGUAGE,
        usb_wheel: FilePath | None = None,
    ) -> None:
        self._wanted, self._settings, self._language = wanted, settings, language
        self._usb_wheel = usb_wheel
        self._stack = ExitStack()
        self._pairs: Sequence[LivePair] = ()
        self._paused: set[tuple[int, Program]] = set()
        self.lanes: Sequence[Lane] = ()
        self.facts: Sequence[LaneFacts] = ()
        self.bus = ""
        self.hand: HandFile | None = None

    def settings_of(self, scenario: Scenario) -> Sequence[LaneSettings]:
        """Return what the lanes of a scenario run with; raises SettingsError."""
        settings = lane_settings(scenario)
        for lane in settings:
            if lane.controller:
                self._language.refuse_law(lane.controller.law_that_reads_the_vehicle)
        return settings

    def start(self, settings: Sequence[LaneSettings]) -> None:
        """Start the lanes, where none run; raises BusError or OSError."""
        with ExitStack() as stack:
            made = TemporaryDirectory(prefix="steer-by-wire-cockpit-", ignore_cleanup_errors=True)
            folder = FilePath(stack.enter_context(made))
            names = [f"lane{number}" for number in range(1, len(settings) + 1)]
            seed = settings[0].plant.seed
            channels = stack.enter_context(
                open_channels(self._wanted, names, folder / "bus.txt", self._settings, seed)
            )
            lanes, pairs = [], []
            device = [] if self._usb_wheel is None else ["--usb-wheel", str(self._usb_wheel)]
            hand = folder / "hand"
            self.hand = HandFile(hand)
            for name, bus, lane in zip(names, channels.buses, settings, strict=True):
                path = build_path(lane.plant.path)
                is_plain = lane.controller is None and lane.hand_wheel is None
                ghost = Ghost(lane.plant) if is_plain else None
                port, listening = BusPort(bus.open()), self._language.listening()
                lanes.append(Lane(port, time.monotonic_ns(), path, ghost, listening))
                stack.callback(lanes[-1].close)
                files = PairFiles(folder / name)
                files.write_settings(lane.plant, lane.controller, hand_wheel=lane.hand_wheel)
                words = [str(hand)]
                if lane.hand_wheel is not None:
                    words += ["--wheel", str(files.settings(HAND_WHEEL_PROGRAM)), *device]
                    device = []
                if lane.is_driven:
                    words += ["--pedals"]
                words += [*self._language.options, *bus.options]
                steers = StartedProgram("steer_by_wire.tools.cockpit.hand", words)
                pair = LivePair(
                    bus,
                    files,
                    controller=None if lane.controller else steers,
                    options=dict.fromkeys(_PROGRAMS.values(), self._language.options),
                    is_recorded=False,
                )
                pairs.append(stack.enter_context(pair))
            self._stack = stack.pop_all()
        laws = law_lines(_line_of(lane) for lane in settings)
        self.facts = [
            lane_facts(lane.label, line, lane.plant)
            for lane, line in zip(settings, laws, strict=True)
        ]
        self.lanes = lanes
        self._pairs, self.bus = pairs, channels.description

    def stop(self) -> None:
        """End all processes and the bus, and close the lanes."""
        for pair in self._pairs:
            for program in _PROGRAMS.values():
                pair.programs.signal(program, signal.SIGCONT)
            pair.interrupt()
        self.lanes = self.facts = self._pairs = ()
        self._paused.clear()
        self._stack.close()

    def act(self, lane: int, program: Program, action: Action) -> None:
        """Kill, pause, resume or restart one process; nothing where that makes no sense.

        To put back is to start the plant of a lost car again.
        """
        if lane >= len(self._pairs):
            return
        pair, name = self._pairs[lane], _PROGRAMS[program]
        if action == "put_back":
            if self.hand is None or not self.lanes[lane].status["lost"]:
                return
            self.hand.let_go()  # its last orders would move the new car
            pair.programs.kill(name)
            action = "restart"
        if action == "restart":
            if pair.programs.status(name) is not None:
                pair.begin(name)
                if program == "plant":
                    self.lanes[lane].on_plant_start()
            return
        number = {"kill": signal.SIGKILL, "pause": signal.SIGSTOP, "resume": signal.SIGCONT}
        pair.programs.signal(name, number[action])
        (self._paused.add if action == "pause" else self._paused.discard)((lane, program))

    def states(self) -> Sequence[Mapping[Program, str]]:
        """Return what the programs of each lane do: running, paused, or ended."""
        return [
            {program: self._state(lane, program) for program in _PROGRAMS}
            for lane in range(len(self.lanes))
        ]

    def _state(self, lane: int, program: Program) -> str:
        if lane >= len(self._pairs):  # they are being started, or ended
            return "ended"
        status = self._pairs[lane].programs.status(_PROGRAMS[program])
        if status is not None:
            return f"ended, status {status}"
        return "paused" if (lane, program) in self._paused else "running"
