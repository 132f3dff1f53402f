"""One plant, its path and its network, to be driven by any controller.

    rig = Rig(Path("out"), "paper_nominal", {"latency.downlink.mean_s": 0.08}, seed=7)
    rig.run("practical_pd_ddob").assert_holds(rms_m=0.02)               # virtual time
    rig.run(["./my_controller", "{channel}"]).assert_holds(rms_m=0.02)  # a program, on a real bus

``rig.run`` takes the name of a controller preset, the path of a settings file (.toml), a function
``make_node(start_ns)`` that returns a node as in ``runtime.node``, or the words of a command.
The first three run in virtual time, a preset or file with ``in_real_time`` as a program. A command
runs in real time: on vcan0 where this machine has it, else on an emulated bus, which Python
programs alone can join (python-can's interface ``emulated``). In its words ``{channel}``, the name
of the interface, and ``{bus}``, python-can's options of either bus, are replaced.
"""

import json
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import can

from ...controller.node.node import ControllerNode
from ...controller.settings import ControllerSettings
from ...plant_emulator.faults.stage import with_faults
from ...plant_emulator.node.node import PlantNode
from ...plant_emulator.settings import PlantSettings
from ...runtime.bus_model.bus_model import BusModel
from ...runtime.node import NEVER_NS, ReportingNode
from ...runtime.settings import SettingsError
from ...runtime.settings.mistakes import hint
from ...runtime.settings.toml_text import dump_toml
from ..channels import BUSES, open_channels
from ..live import Bus, PairFiles
from ..processes import ProcessError, Processes
from ..result import Trace
from ..simulate import NO_OVERRIDES, START_S_MAX, settings_of
from ..virtual import BITRATE_BIT_S, run_virtual_nodes
from .outcome import Outcome

MakeNode = Callable[[int], ReportingNode]
_POLL_S = 0.05
__tracebackhide__ = True  # pytest shows the line of the test that made the mistake


class Rig:
    """Runs controllers against one plant.

    ``folder``     where each run leaves a folder of its own; made when needed
    ``plant``      name of a plant preset, a settings file (.toml), or settings
    ``overrides``  other settings of the plant, by ``table.key``
    ``seed``       of all randomness
    ``bus``        socketcan, emulated, or auto: vcan0 where this machine has it, else emulated

    Raises SettingsError for settings that cannot be used.
    """

    def __init__(
        self,
        folder: Path,
        plant: str | Path | PlantSettings = "paper_nominal",
        overrides: Mapping[str, Any] = NO_OVERRIDES,
        seed: int | None = None,
        bus: str = "auto",
    ) -> None:
        if bus not in BUSES:
            raise SettingsError(f"bus {bus}: there is none of this name ({hint(bus, BUSES)})")
        values = {**overrides, **({} if seed is None else {"seed": seed})}
        self.settings = settings_of(PlantSettings, plant, values)
        self.bus = bus
        self.outcomes: list[Outcome] = []
        self._folder = folder

    def run(
        self,
        controller: str | MakeNode | Sequence[str],
        overrides: Mapping[str, Any] = NO_OVERRIDES,
        *,
        in_real_time: bool = False,
    ) -> Outcome:
        """Drive the plant to the end of its motion; returns what came of it.

        ``overrides``  other settings of a preset or file

        Raises SettingsError for settings that cannot be used, ProcessError when the plant fails.
        """
        try:
            outcome = self._run(controller, overrides, in_real_time)
        except (SettingsError, ProcessError) as error:
            raise error.with_traceback(None) from None
        self.outcomes.append(outcome)
        return outcome

    def _run(
        self,
        controller: str | MakeNode | Sequence[str],
        overrides: Mapping[str, Any],
        in_real_time: bool,
    ) -> Outcome:
        files = PairFiles(self._folder / f"run{len(self.outcomes) + 1}")
        files.folder.mkdir(parents=True, exist_ok=True)
        files.settings("plant_emulator").write_text(dump_toml(self.settings), encoding="utf-8")
        if callable(controller):
            return self._in_virtual_time(controller, files)
        if not isinstance(controller, str):
            return self._in_real_time("steer_by_wire.closed_loop.rig.command", controller, files)
        settings = settings_of(ControllerSettings, controller, overrides)
        files.settings("controller").write_text(dump_toml(settings), encoding="utf-8")
        if in_real_time:
            words = [str(files.settings("controller")), "{bus}"]
            return self._in_real_time("steer_by_wire.controller", words, files)
        return self._in_virtual_time(lambda start_ns: ControllerNode(settings, start_ns), files)

    def _in_virtual_time(self, make_node: MakeNode, files: PairFiles) -> Outcome:
        plant = PlantNode(self.settings, 0)
        edge = with_faults(plant, self.settings.faults, self.settings.seed)
        bus, log = BusModel(BITRATE_BIT_S), files.candump_log
        seconds = iter(range(START_S_MAX))

        def has_not_begun() -> bool:
            return plant.motion_start_ns == NEVER_NS and next(seconds, None) is None

        controller = make_node(0)
        run_virtual_nodes(edge, controller, bus, log, has_not_begun)
        failure = controller.report().get("failure")
        ending = f"controller is in its safe state: {failure}" if failure else ""
        report, trace = dict(edge.report()), Trace.of_node(plant)
        return Outcome(files, "virtual time", self.settings, report, trace, ending)

    def _in_real_time(self, module: str, words: Sequence[str], files: PairFiles) -> Outcome:
        log = files.folder / "bus.txt"
        with open_channels(self.bus, ["rig"], log) as channels:
            (bus,) = channels.buses
            report, ending = self._run_programs(bus, module, _filled(words, bus), files)
        trace = Trace.read(files.plant_trace)
        return Outcome(files, channels.description, self.settings, report, trace, ending)

    def _run_programs(
        self, bus: Bus, module: str, words: Sequence[str], files: PairFiles
    ) -> tuple[dict[str, Any], str]:
        ending = ""
        writer = can.CanutilsLogWriter(files.candump_log, channel=bus.channel)
        with (
            Processes(files.folder) as programs,
            bus.open() as listener,
            can.Notifier(listener, [writer]),
        ):
            plant_words = [*bus.options, "--trace", str(files.plant_trace)]
            plant_words += ["--report", str(files.report("plant_emulator"))]
            plant_words.append(str(files.settings("plant_emulator")))
            programs.start("plant_emulator", "steer_by_wire.plant_emulator", plant_words)
            programs.begin("controller", module, words)
            until_s = time.monotonic() + START_S_MAX + self.settings.duration_s
            while programs.status("plant_emulator") is None and time.monotonic() < until_s:
                if programs.status("controller") is not None:
                    ending = str(programs.failure("controller"))
                    break
                time.sleep(_POLL_S)
            status = programs.end("plant_emulator")
            programs.end("controller")
            if status:
                raise programs.failure("plant_emulator")
        node: dict[str, Any] = json.loads(files.report("plant_emulator").read_text("utf-8"))["node"]
        return node, ending


def _filled(words: Sequence[str], bus: Bus) -> list[str]:
    if bus.interface != "socketcan" and "{bus}" not in words and "{channel}" in " ".join(words):
        raise SettingsError(
            f"{words[0]}: an emulated bus is no interface that {{channel}} could name; run "
            "steer-by-wire with-vcan pytest for a vcan0, or give a program in Python {bus}"
        )
    filled: list[str] = []
    for word in words:
        if word == "{bus}":
            filled += bus.options
        else:
            filled.append(word.replace("{channel}", bus.channel))
    return filled
