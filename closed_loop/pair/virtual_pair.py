"""Plant emulator and controller together in one process, in virtual time."""

from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing
from hashlib import sha256
from pathlib import Path
from typing import Generic, NamedTuple, TypeVar

from ...controller.node.node import ControllerNode
from ...controller.settings import ControllerSettings
from ...dbc.bus_language import OUR_LANGUAGE, BusLanguage
from ...dbc.secoc.authenticated_node import AuthenticatedNode
from ...dbc.secoc.authentication import Authentication, ComputeMac
from ...dbc.secoc.secured_frame import CHALLENGE_LENGTH
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
from ...runtime.program.priority_and_memory_lock import no_collections
from ...runtime.recording.candump import CandumpLog
from .pair_result import PairResult, Trace
from .virtual_bus import QUIET_BUS, Controlled, virtual_bus

SLICE_NS = 1_000_000_000
START_S_MAX = 60
"""After this time a plant that waits for its first command waits in vain [s]."""
N = TypeVar("N", bound=ReportingNode)


class VirtualPair(NamedTuple, Generic[N]):
    """Both nodes of a run that begins at 0, and a hand wheel if there is one.

    ``plant``            the plant itself, with its samples
    ``edge``             the plant behind the faults of its settings: the node on the bus
    ``controller``       the controller itself
    ``controller_edge``  as it is on the bus
    """

    plant: PlantNode
    edge: ReportingNode
    controller: N
    controller_edge: ReportingNode
    hand_wheel: ReportingNode | None = None

    def run(
        self,
        bus: Wire | None = None,
        candump_log: Path | None = None,
        should_stop: Callable[[], bool] = lambda: False,
        on_wire: Callable[[int, int, Frame], None] | None = None,
    ) -> None:
        """Run until the plant has finished, has waited START_S_MAX in vain, or ``should_stop()``.

        ``bus``  between them; None is a wire that takes no time

        The others are as in ``run_virtual_nodes``.
        """
        seconds = iter(range(START_S_MAX))

        def ends() -> bool:
            return should_stop() or (not self.has_started and next(seconds, None) is None)

        others = () if self.hand_wheel is None else (self.hand_wheel,)
        nodes = self.edge, self.controller_edge
        run_virtual_nodes(*nodes, bus, candump_log, ends, on_wire, others)

    @property
    def has_started(self) -> bool:
        """Whether the plant has begun to move."""
        return self.plant.motion_start_ns != NEVER_NS


def make_virtual_pair(
    plant: PlantSettings,
    controller: ControllerSettings,
    plant_samples_max: int = SAMPLES_MAX,
    controller_samples_max: int = 0,
    *,
    language: BusLanguage = OUR_LANGUAGE,
    hand_wheel: ReportingNode | None = None,
) -> VirtualPair[ControllerNode]:
    """Make both nodes of the settings, not yet run.

    ``plant_samples_max``, ``controller_samples_max``  how many samples each keeps
    """
    node = ControllerNode(controller, 0, controller_samples_max)
    return pair_with(plant, node, plant_samples_max, language, hand_wheel)


def pair_with(
    settings: PlantSettings,
    controller: N,
    samples_max: int = SAMPLES_MAX,
    language: BusLanguage = OUR_LANGUAGE,
    hand_wheel: ReportingNode | None = None,
) -> VirtualPair[N]:
    """Make a plant for any controller; the one place where nodes are put together.

    The plant and our controller speak the language of the bus; another one does so of itself.
    """
    plant, edge = make_virtual_plant(settings, samples_max, language)
    controller_edge: ReportingNode = controller
    if isinstance(controller, ControllerNode):
        controller.leave_out(language.missing)
        controller_edge = language.at_edge(controller, End.CONTROLLER, 0)
    return VirtualPair(plant, edge, controller, controller_edge, hand_wheel)


def with_key(pair: VirtualPair[N], compute_mac: ComputeMac, seed: int) -> VirtualPair[N]:
    """Return the nodes behind authentication with the CMAC of a key.

    Their challenges come from the seed, so that a run in virtual time can be made again.
    """
    present = {"PLANT": pair.edge, "CONTROLLER": pair.controller_edge}
    if pair.hand_wheel is not None:
        present["HAND_WHEEL"] = pair.hand_wheel

    def secured(own: str) -> ReportingNode:
        challenge = sha256(f"{own} {seed}".encode()).digest()[:CHALLENGE_LENGTH]
        end = Authentication([name for name in present if name != own], compute_mac, challenge, 0)
        return AuthenticatedNode(present[own], end)

    edge, controller_edge, *others = map(secured, present)
    return VirtualPair(pair.plant, edge, pair.controller, controller_edge, *others)


def make_virtual_plant(
    settings: PlantSettings, samples_max: int = SAMPLES_MAX, language: BusLanguage = OUR_LANGUAGE
) -> tuple[PlantNode, ReportingNode]:
    """Make the plant, and its node on the bus, behind the faults of its settings."""
    plant = PlantNode(settings, 0, samples_max=samples_max)
    spoken = language.at_edge(plant, End.PLANT, 0)
    return plant, with_faults(spoken, settings.faults, settings.seed, messages_in(language))


def run_virtual_pair(
    plant: PlantSettings,
    controller: ControllerSettings,
    bus: BusSettings | None = QUIET_BUS,
    candump_log: Path | None = None,
) -> PairResult:
    """Run the nodes of the settings until the plant has finished.

    ``bus``          between them; None is a wire that takes no time
    ``candump_log``  where every frame is written, as ``candump -L`` prints it

    Raises SettingsError.
    """
    pair = make_virtual_pair(plant, controller)
    pair.run(virtual_bus(bus, plant.seed), candump_log)
    of_plant, of_controller = (
        {"settings": settings.model_dump(mode="json"), "node": dict(node.report())}
        for settings, node in ((plant, pair.edge), (controller, pair.controller))
    )
    return PairResult(of_plant, of_controller, Trace.of_node(pair.plant))


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
            on_wire = _writer(stack.enter_context(closing(CandumpLog(candump_log, "virtual"))))
        executor = VirtualTimeExecutor(nodes, bus, on_wire)
        until_ns = SLICE_NS
        while not (executor.finished or should_stop()):
            executor.run(until_ns)
            until_ns += SLICE_NS


def _writer(log: CandumpLog) -> Callable[[int, int, Frame], None]:
    return lambda time_ns, _sender, frame: log.write(time_ns, frame)
