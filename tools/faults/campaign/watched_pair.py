"""The pair of a run: both nodes watched, the plant behind the fault stage, the bus between them."""

from collections.abc import Sequence
from contextlib import ExitStack
from functools import lru_cache
from typing import Any, NamedTuple

from ....closed_loop.lockstep.node import LockstepNode, controller_node
from ....plant_emulator.faults.settings import SIGNAL_FAULTS, FaultDirection, FaultKind
from ....plant_emulator.faults.stage import FaultyNode
from ....plant_emulator.node.node import PlantNode
from ....plant_emulator.vehicle.motion_parameters import motion_params
from ....runtime.bus_model.bus_model import BusModel
from ....runtime.emulated_bus.transmit_buffers import BUFFER_FULL
from ....runtime.node import NEVER_NS, NS_PER_S, ReportingNode
from ....runtime.node.end import End
from ....runtime.node.virtual_time_loop import VirtualTimeExecutor
from .babbled_bus import BABBLER_ID, BabbledBus
from .campaign_file import NodeFaultKind
from .campaign_runs import FaultCase, Scenario, controller_settings_of, plant_settings_of
from .detectability import Sight, causes_of, sight_of
from .node_faults import NodeFault, with_node_faults
from .node_watch import Watch, bounds_of
from .program_node import ProgramNode
from .recovery import Way, way_of

_CORRUPTING = frozenset({FaultKind.BIT_FLIPS, FaultKind.WRONG_LENGTH, FaultKind.WRONG_IDENTIFIER})
"""Kinds that break a frame's protection."""
_FORGING = SIGNAL_FAULTS | {FaultKind.OUT_OF_RANGE}
"""Kinds that make frames nobody has sent, with a valid protection."""
_FALSIFYING = frozenset(FaultKind) - {
    FaultKind.DROP,
    FaultKind.BURST_LOSS,
    FaultKind.DUPLICATE,
    FaultKind.REORDER,
    FaultKind.DELAY_SPIKE,
}
"""Kinds that hand over frames other than those just sent; the rest lose, double or delay."""
_PARAMS_KEPT = 64


class Pair(NamedTuple):
    """The two nodes of a run, watched; the plant behind the fault stage.

    ``running``  ends the controller if it is a program
    """

    plant_node: PlantNode
    edge: FaultyNode[Watch]
    plant: Watch
    controller: Watch
    bus: BabbledBus
    sight: Sight
    way: Way
    running: ExitStack


def make_pair(scenario: Scenario, further: Sequence[NodeFault] = ()) -> Pair:
    """Return the pair of a run, not yet run.

    ``further``  more faults of nodes than that of the case; one of all may be a babbling node
    """
    case = scenario.case
    node_faults = [*further] if case.node_fault is None else [case.node_fault, *further]
    plant = plant_settings_of(scenario, case.faults)
    controller = controller_settings_of(scenario.law, scenario.spec.ftti_ms)
    onset_ns = min([onset_ns_of(case), *(fault.window_ns[0] for fault in further)])
    bounds = bounds_of(plant, controller)
    wanted = causes_of(case.expected.mechanisms)
    kinds = {fault.kind for fault in case.faults}
    # Where frames are forged too, a frame that nobody has sent may be intact.
    # A node that nobody receives cannot have its frames accepted.
    is_corrupting = kinds & _CORRUPTING and not kinds & _FORGING and not case.is_unreceived

    def watched(node: ReportingNode, name: str, peer_sent: set[Any] | None) -> Watch:
        own = wanted if case.receiver in (name, "both") else ()
        struck = with_node_faults(node, name, node_faults)
        true_frames = peer_sent if is_corrupting else None
        return Watch(struck, bounds, onset_ns, own, case.expected.safe_state, true_frames)

    sent_by_plant: set[Any] = set()
    running = ExitStack()
    made = running.enter_context(controller_node(scenario.spec.command or controller))
    if isinstance(made, LockstepNode):
        controller_watch = watched(ProgramNode(made), End.CONTROLLER, None)
    else:
        controller_watch = watched(made, End.CONTROLLER, sent_by_plant)
    motion = _motion_params(plant.vehicle, plant.actuator, plant.path, plant.disturbance)
    node = PlantNode(plant, 0, motion)
    plant_watch = watched(node, End.PLANT, controller_watch.sent)
    plant_watch.sent = sent_by_plant
    start_ns, stop_ns = NEVER_NS, NEVER_NS
    for fault in node_faults:
        if fault.kind is NodeFaultKind.BABBLING:
            start_ns, stop_ns = fault.window_ns
    model = BusModel(scenario.spec.bitrate_bit_s, queue_limit=BUFFER_FULL)
    bus = BabbledBus(model, BABBLER_ID, start_ns, stop_ns)
    edge = FaultyNode(plant_watch, case.faults, scenario.seed)
    for stage in edge.stages:
        is_down = stage.settings.direction is FaultDirection.DOWNLINK
        # What a program believes is not known.
        watch = plant_watch if is_down else controller_watch
        if stage.settings.kind in _FALSIFYING and (is_down or not scenario.spec.command):
            stage.on_change = watch.expect_false
    way = way_of(plant, controller, scenario.point, 1e-3 * scenario.spec.ftti_ms)
    sight = sight_of(plant, controller)
    return Pair(node, edge, plant_watch, controller_watch, bus, sight, way, running)


def run_pair(scenario: Scenario, pair: Pair) -> None:
    """Run a pair to the end of its motion."""
    end_ns = round((scenario.spec.motion_s + 0.2) * NS_PER_S)
    with pair.running:
        VirtualTimeExecutor((pair.edge, pair.controller), pair.bus).run(end_ns)
    if failure := pair.controller.report().get("program_failure"):
        pair.controller.invalid.append(failure)


def onset_ns_of(case: FaultCase) -> int:
    """Return from when counters are compared with those before [ns]; 0 for a golden run."""
    if case.node_fault is not None:
        return case.node_fault.window_ns[0]
    # The stage's clock starts with the first command, some periods after this one.
    return min((round(fault.onset_s * NS_PER_S) for fault in case.faults), default=0)


_motion_params = lru_cache(maxsize=_PARAMS_KEPT)(motion_params)
