"""Plant emulator and controller together in one process, in virtual time."""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

from ...controller.node.node import ControllerNode
from ...controller.settings import ControllerSettings
from ...dbc.bus_language import OUR_LANGUAGE, BusLanguage
from ...plant_emulator.evaluation.run_record import SAMPLES_MAX
from ...plant_emulator.faults.messages_on_bus import messages_in
from ...plant_emulator.faults.stage import with_faults
from ...plant_emulator.node.node import PlantNode
from ...plant_emulator.settings import PlantSettings
from ...runtime.bus_model.bus_model import BusModel
from ...runtime.bus_model.settings import BusSettings
from ...runtime.frame import Frame
from ...runtime.node import NEVER_NS, ReportingNode
from ...runtime.node.end import End
from ...runtime.node.virtual_time_loop import VirtualTimeExecutor, Wire
from ...runtime.program.garbage_collection import no_collections
from ...runtime.recording.candump import CandumpLog
from .pair_result import PairResult, Trace
from .virtual_bus import QUIET_BUS, Controlled, virtual_bus

SLICE_NS = 1_000_000_000
START_S_MAX = 60
"""After this time a plant that waits for its first command waits in vain [s]."""


class VirtualPair(NamedTuple):
    """Both nodes of a run that begins at 0.

    ``plant``  the plant itself, with its samples
    ``edge``   the plant behind the faults of its settings: the node on the bus
    """

    plant: PlantNode
    edge: ReportingNode
    controller: ControllerNode


def make_virtual_pair(
    plant_settings: PlantSettings,
    controller_settings: ControllerSettings,
    plant_samples_max: int = SAMPLES_MAX,
    controller_samples_max: int = 0,
) -> VirtualPair:
    """Make both nodes, not yet run; the one place where tools build them for virtual time.

    ``plant_samples_max``, ``controller_samples_max``  how many samples each keeps
    """
    plant, edge = make_virtual_plant(plant_settings, plant_samples_max)
    return VirtualPair(plant, edge, ControllerNode(controller_settings, 0, controller_samples_max))


def make_virtual_plant(
    settings: PlantSettings, samples_max: int = SAMPLES_MAX, language: BusLanguage = OUR_LANGUAGE
) -> tuple[PlantNode, ReportingNode]:
    """Make the plant, and its node on the bus, behind the faults of its settings."""
    plant = PlantNode(settings, 0, samples_max=samples_max)
    spoken = language.at_edge(plant, End.PLANT, 0)
    return plant, with_faults(spoken, settings.faults, settings.seed, messages_in(language))


def run_virtual_pair(
    plant_settings: PlantSettings,
    controller_settings: ControllerSettings,
    settings: BusSettings | None = QUIET_BUS,
    candump_log: Path | None = None,
) -> PairResult:
    """Run both nodes until the plant has finished.

    ``settings``     of the bus between them; None is a wire that takes no time
    ``candump_log``  where every frame is written, as ``candump -L`` prints it

    Raises SettingsError.
    """
    pair = make_virtual_pair(plant_settings, controller_settings)
    bus = None if settings is None else virtual_bus(settings, plant_settings.seed)
    is_in_vain = waits_in_vain(pair.plant, START_S_MAX)
    run_virtual_nodes(pair.edge, pair.controller, bus, candump_log, is_in_vain)
    return PairResult(
        {"settings": plant_settings.model_dump(mode="json"), "node": dict(pair.edge.report())},
        {
            "settings": controller_settings.model_dump(mode="json"),
            "node": dict(pair.controller.report()),
        },
        Trace.of_node(pair.plant),
    )


def run_virtual_nodes(
    plant: ReportingNode,
    controller: ReportingNode,
    bus: Wire | None,
    candump_log: Path | None,
    should_stop: Callable[[], bool],
    on_wire: Callable[[int, int, Frame], None] | None = None,
    others: Sequence[ReportingNode] = (),
) -> None:
    """Run nodes that start at 0 until the plant has finished or ``should_stop()``.

    ``should_stop``  is asked every SLICE_NS of virtual time
    ``on_wire``      is called with every frame if there is no ``candump_log``: its time and sender
    ``others``       tick after the two at one instant
    """
    with ExitStack() as stack:
        stack.enter_context(no_collections())
        nodes: tuple[ReportingNode, ...] = (plant, controller, *others)
        if isinstance(bus, BusModel) and bus.errors is not None:
            nodes = tuple(Controlled(node, index, bus) for index, node in enumerate(nodes))
        if candump_log is not None:
            on_wire = _writer(stack.enter_context(CandumpLog(candump_log, "virtual")))
        executor = VirtualTimeExecutor(nodes, bus, on_wire)
        until_ns = SLICE_NS
        while not (executor.finished or should_stop()):
            executor.run(until_ns)
            until_ns += SLICE_NS


def waits_in_vain(plant: PlantNode, start_s_max: int) -> Callable[[], bool]:
    """Return what tells, asked every SLICE_NS, whether no command has come for ``start_s_max``."""
    seconds = iter(range(start_s_max))
    return lambda: plant.motion_start_ns == NEVER_NS and next(seconds, None) is None


def _writer(log: CandumpLog) -> Callable[[int, int, Frame], None]:
    return lambda time_ns, _sender, frame: log.write(time_ns, frame)
