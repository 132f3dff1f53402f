"""One plant, its path and its network, to be driven by any controller.

    rig = Rig(Path("out"), "paper_nominal", {"latency.downlink.mean_s": 0.08}, seed=7)
    rig.run("practical_pd_ddob").assert_holds(rms_m=0.1)           # virtual time
    rig.run(["./my_controller", "{channel}"]).assert_holds()  # a program, on a real bus
    rig.run(["./my_controller"], lockstep=True)                         # the same, virtual time

``rig.run`` takes the name of a controller preset, the path of a settings file (.toml), a function
``make_node(start_ns)`` that returns a node as in ``runtime.node``, or the words of a command.
The first three run in virtual time, a preset or file with ``in_real_time`` as a program. A command
with ``lockstep`` runs in virtual time: it speaks the protocol of ``closed_loop.lockstep`` on its
standard input and output. Without, it runs in real time: on vcan0 where this machine has it, else
on an emulated bus, which Python programs alone can join (python-can's interface ``emulated``). In
its words ``{channel}``, the name of the interface, and ``{bus}``, python-can's options of either
bus, are replaced.

``hand_wheel`` adds a hand wheel to a preset or file in virtual time: a preset or file of the hand
wheel, a function, or the words of a program in lockstep.
"""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeGuard

from ...controller.node.node import ControllerNode
from ...controller.settings import ControllerSettings
from ...dbc.bus_language import read_language
from ...hand_wheel.node import HandWheelNode
from ...hand_wheel.settings import HandWheelSettings
from ...plant_emulator.faults.messages_on_bus import naming
from ...plant_emulator.settings import PlantSettings
from ...runtime.bus_model.bus_model import BusModel
from ...runtime.node import NS_PER_S, ReportingNode, Wrapper
from ...runtime.output_file import write_text
from ...runtime.settings import SettingsError
from ...runtime.settings.mistakes import hint
from ...runtime.settings.toml_text import dump_toml
from ..lockstep.node import LockstepNode
from ..lockstep.peer import lockstep_peer
from ..pair.live_bus import BUSES, Bus, open_channels
from ..pair.live_pair import LivePair, Program
from ..pair.pair_result import CONTROLLER_PROGRAM, PLANT_PROGRAM, PairFiles, Trace
from ..pair.virtual_bus import QUIET_BUS
from ..pair.virtual_pair import START_S_MAX, pair_with
from ..pair.with_hand_wheel import with_hand_wheel
from ..processes.foreign_program import STATUS_KILLED
from ..processes.process_group import ProcessError, Processes
from ..scripting.simulate import NO_OVERRIDES, settings_of
from .outcome_and_assertions import Outcome

MakeNode = Callable[[int], ReportingNode]
Foreign = MakeNode | Sequence[str]
Ours = str | Path | ControllerSettings
_COMMAND = "steer_by_wire.closed_loop.processes.foreign_program"
_POLL_S = 0.05
__tracebackhide__ = True  # pytest shows the line of the test that made the mistake


class Rig:
    """Runs controllers against one plant.

    ``folder``     where each run leaves a folder of its own; made when needed
    ``plant``      name of a plant preset, a settings file (.toml), or settings
    ``overrides``  other settings of the plant, by ``table.key``
    ``seed``       of all randomness
    ``bus``        socketcan, emulated, or auto: vcan0 where this machine has it, else emulated
    ``dialect``    file of a car whose messages the plant speaks, and our controllers; a command or
                   a function speaks them of itself

    Raises SettingsError for settings that cannot be used.
    """

    def __init__(
        self,
        folder: str | Path,
        plant: str | Path | PlantSettings = "paper_nominal",
        overrides: Mapping[str, Any] = NO_OVERRIDES,
        seed: int | None = None,
        bus: str = "auto",
        dialect: Path | str | None = None,
    ) -> None:
        if bus not in BUSES:
            raise SettingsError(f"bus {bus}: there is none of this name ({hint(bus, BUSES)})")
        values = {**overrides, **({} if seed is None else {"seed": seed})}
        self._language = read_language(dialect)
        self.settings = settings_of(PlantSettings, plant, values, context=naming(self._language))
        self.bus = bus
        self.outcomes: list[Outcome] = []
        self._folder = Path(folder)

    def run(
        self,
        controller: Ours | Foreign,
        overrides: Mapping[str, Any] = NO_OVERRIDES,
        *,
        in_real_time: bool = False,
        lockstep: bool = False,
        hand_wheel: str | Path | HandWheelSettings | Foreign | None = None,
    ) -> Outcome:
        """Drive the plant to the end of its motion; returns what came of it.

        ``overrides``     other settings of a preset or file
        ``in_real_time``  run a preset or file as a program on a bus
        ``lockstep``      run a command in virtual time
        ``hand_wheel``    of a preset or file in virtual time; the plant and the controller get what
                          it needs, as in ``simulate``

        Raises SettingsError for settings that cannot be used, ProcessError when the plant fails.
        """
        try:
            outcome = self._run(controller, overrides, in_real_time, lockstep, hand_wheel)
        except (SettingsError, ProcessError) as error:
            raise error.with_traceback(None) from None
        if (car := self._language.car) is not None:
            outcome = outcome._replace(dialect=self._language.file, rate_hz=car.command_rate_hz)
        self.outcomes.append(outcome)
        return outcome

    def _run(
        self,
        controller: Ours | Foreign,
        overrides: Mapping[str, Any],
        in_real_time: bool,
        lockstep: bool,
        hand_wheel: str | Path | HandWheelSettings | Foreign | None,
    ) -> Outcome:
        _refuse_misfit(controller, bool(overrides), in_real_time, lockstep)
        if hand_wheel is not None and (in_real_time or not isinstance(controller, Ours)):
            raise SettingsError("hand_wheel: needs a preset or a settings file, in virtual time")
        if hand_wheel is not None and self._language.car is not None:
            raise SettingsError("hand_wheel: a rig with a dialect has none")
        files = PairFiles(self._folder / f"run{len(self.outcomes) + 1}")
        files.folder.mkdir(parents=True, exist_ok=True)
        if not isinstance(controller, Ours):
            write_text(files.settings(PLANT_PROGRAM), dump_toml(self.settings))
            if not (lockstep or callable(controller)):
                return self._in_real_time(self.settings, files, controller)
            with _made(controller) as node:
                return self._in_virtual_time(node, self.settings, files)
        settings = settings_of(ControllerSettings, controller, overrides)
        self._language.refuse_law(settings.law_that_reads_the_vehicle)
        plant = self.settings
        if hand_wheel is None:
            files.write_settings(plant, settings)
            if in_real_time:
                outcome = self._in_real_time(plant, files)
            else:
                outcome = self._in_virtual_time(ControllerNode(settings, 0), plant, files)
        else:
            own, foreign = HandWheelSettings(), None
            if callable(hand_wheel) or _is_command(hand_wheel):
                foreign = hand_wheel
            else:
                given: Any = hand_wheel
                own = settings_of(HandWheelSettings, given, {})
            plant, settings, own = with_hand_wheel(plant, settings, own)
            files.write_settings(plant, settings, hand_wheel=own if foreign is None else None)
            with _made(own if foreign is None else foreign) as wheel:
                outcome = self._in_virtual_time(ControllerNode(settings, 0), plant, files, wheel)
        return outcome._replace(rate_hz=NS_PER_S / settings.period_ns)

    def _in_virtual_time(
        self,
        node: ReportingNode,
        settings: PlantSettings,
        files: PairFiles,
        hand_wheel: ReportingNode | None = None,
    ) -> Outcome:
        pair = pair_with(settings, node, language=self._language, hand_wheel=hand_wheel)
        pair.run(BusModel(QUIET_BUS.bitrate_bit_s), files.candump_log)
        ending = ""
        for name, made in (("hand wheel", hand_wheel), ("controller", pair.controller)):
            if failure := made and made.report().get("failure"):
                state = "" if isinstance(made, LockstepNode) else "is in its safe state: "
                ending = f"{name} {state}{failure}"
        report, trace = dict(pair.edge.report()), Trace.of_node(pair.plant)
        return Outcome(files, "virtual time", settings, report, trace, ending)

    def _in_real_time(
        self, settings: PlantSettings, files: PairFiles, words: Sequence[str] | None = None
    ) -> Outcome:
        """Run the plant with our controller, or with the command ``words`` in its place."""
        with open_channels(self.bus, ["rig"], files.folder / "bus.txt") as channels:
            (bus,) = channels.buses
            command = None if words is None else Program(_COMMAND, _filled(words, bus))
            options = dict.fromkeys((PLANT_PROGRAM, CONTROLLER_PROGRAM), self._language.options)
            with LivePair(bus, files, controller=command, options=options) as pair:
                ending = self._wait(pair.programs)
            report = pair.report(PLANT_PROGRAM)["node"]
            ignored_sigterm = (
                not ending and pair.programs.status(CONTROLLER_PROGRAM) == STATUS_KILLED
            )
        trace, cut_off = Trace.read(files.plant_trace), pair.recording_failure
        where = channels.description
        return Outcome(
            files, where, settings, report, trace, ending, cut_off, ignored_sigterm=ignored_sigterm
        )

    def _wait(self, programs: Processes) -> str:
        """Wait for the end of the plant or of the controller; returns how the latter ended."""
        until_s = time.monotonic() + START_S_MAX + self.settings.duration_s
        while programs.status(PLANT_PROGRAM) is None and time.monotonic() < until_s:
            if programs.status(CONTROLLER_PROGRAM) is not None:
                return str(programs.failure(CONTROLLER_PROGRAM))
            time.sleep(_POLL_S)
        return ""


@contextmanager
def _made(node: Foreign | HandWheelSettings) -> Iterator[ReportingNode]:
    """Make a node of a run in virtual time."""
    if isinstance(node, HandWheelSettings):
        yield HandWheelNode(node, 0)
    elif callable(node):
        if not hasattr(made := node(0), "on_tick"):
            raise SettingsError(f"{node}: returned {made!r}, which is no node")
        # Wrapped, because a node of ours would be put behind a gateway.
        yield Wrapper(made)
    else:
        with lockstep_peer(node) as peer:
            yield LockstepNode(peer, 0)


def _is_command(given: object) -> TypeGuard[Sequence[str]]:
    words = given if isinstance(given, list | tuple) else ()
    return bool(words) and all(isinstance(word, str) for word in words)


def _refuse_misfit(given: object, overrides: bool, in_real_time: bool, lockstep: bool) -> None:
    """Raise SettingsError for a controller that cannot be run, or not as it is asked for."""
    is_ours, is_command = isinstance(given, Ours), _is_command(given)
    is_line = isinstance(given, str) and not given.endswith(".toml") and set(given) & set("/ {")
    if is_line or not (is_ours or is_command or callable(given)):
        raise SettingsError(
            f"controller: {given!r} is no preset, settings file (.toml) or function that makes a"
            " node; a program is given by its words, as ['./my_controller', '{channel}']"
        )
    if overrides and not is_ours:
        raise SettingsError("overrides: are for a preset or a settings file")
    if lockstep and (in_real_time or not is_command):
        raise SettingsError("lockstep: is for the words of a command, in virtual time")
    if in_real_time and callable(given):
        raise SettingsError("in_real_time: a function runs in virtual time")


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
