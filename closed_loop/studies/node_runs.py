"""Runs of a study over a bus: the two nodes in virtual time.

Compiled runs have a wire that takes no time. Where a study has a bus, with its bit rate, rest bus,
errors and clocks, the nodes themselves run on it, some thousand times slower. There the controller
may be a program in lockstep: its commands are known from the bus.
"""

from collections import defaultdict
from collections.abc import Iterable, Mapping
from math import nan
from typing import Any

import numpy as np

from ...controller.node.node import ControllerNode
from ...dbc import messages
from ...dbc.bus_language import read_language
from ...dbc.messages import Freshness, Mode, SafetyState, SteeringStatusCode
from ...hand_wheel.feedback_laws import FEEDBACK_LAWS
from ...hand_wheel.node import HandWheelNode
from ...plant_emulator.evaluation.run_verdict import RANGE_M, RunEnd, VerdictRules
from ...plant_emulator.path.cg_deviation import cg_deviation_m
from ...runtime.array_types import FloatArray
from ...runtime.frame import Frame
from ...runtime.node import NS_PER_S
from ..compiled.hand_wheel_events import felt_delay_on_bus_s, felt_delay_s
from ..compiled.schedule import schedule_run
from ..lockstep.node import LockstepNode, controller_node
from ..pair.virtual_bus import shared_bus
from ..pair.virtual_pair import VirtualPair, pair_with
from ..scripting.simulated_run import PlantTable
from .compiled_figures import (
    COUNTED,
    HandWheelFigures,
    farthest_outside_m,
    figures_of,
    latency_figures,
)
from .scenario import Pair

_LEFT_MODES = (Mode.HOLDING, Mode.SAFE_STOP)
_LEFT_CODES = (
    SteeringStatusCode.HOLDING,
    SteeringStatusCode.FALLBACK,
    SteeringStatusCode.SAFE_STATE,
)


class ReactionWatch:
    """Watches the messages of a run, in their order on the bus, whatever the controller is.

    A report is a count of CONTROLLER_SAFETY or PLANT_STATUS that rises, a message that is stale, or
    a state that is not normal. Control is left by a command whose mode is not ACTIVE, or by a
    steering that holds its wheel. Where the network itself loses frames, such a report may be of
    that.
    """

    def __init__(self) -> None:
        self.sent_rad: list[float] = []
        """The commands on the bus, plans left out."""
        self.frames: dict[type, list[tuple[int, int]]] = defaultdict(list)
        """With a hand wheel: counter of each frame of a message, and when it was complete [ns]."""
        self._reported_ns: list[int] = []
        self._left_ns: list[int] = []
        self._counts: dict[type, tuple[int, ...]] = {}

    def on_message(self, time_ns: int, message: messages.Message) -> None:
        """Take a message."""
        is_wrong, counts = False, tuple[int, ...]()
        match message:
            case messages.SteeringCommand() | messages.SteeringPlan():
                if isinstance(message, messages.SteeringCommand):
                    self.sent_rad.append(message.steer_rad)
                if message.mode in _LEFT_MODES:
                    self._left_ns.append(time_ns)
            case messages.SteeringStatus():
                if message.status in _LEFT_CODES:
                    self._left_ns.append(time_ns)
            case messages.ControllerSafety():
                counts = message.rejected, message.lost
                is_wrong = Freshness.STALE in (
                    message.lateral_error_freshness,
                    message.steering_status_freshness,
                    message.vehicle_state_freshness,
                )
            case messages.PlantStatus():
                counts, is_wrong = (message.rejected,), message.safety is not SafetyState.NORMAL
        before = self._counts.get(type(message), counts)
        self._counts[type(message)] = counts
        if is_wrong or counts != before:
            self._reported_ns.append(time_ns)

    def reactions(self, faults: Iterable[Mapping[str, Any]]) -> dict[str, float]:
        """Return the columns of a run with the plant's report on each of its faults [s].

        ``fault_s``     the first frame that a fault changed, from the run's start; none if none was
        ``reported_s``  from then until it was reported on the bus
        ``reaction_s``  from then until a node left control
        """
        known_s = [fault["first_s"] for fault in faults if fault["first_s"] is not None]
        if not known_s:
            return {}
        fault_s = min(known_s)
        reported_s, reaction_s = (
            _first_s(times_ns, fault_s) for times_ns in (self._reported_ns, self._left_ns)
        )
        return {"fault_s": fault_s, "reported_s": reported_s, "reaction_s": reaction_s}


def _first_s(times_ns: Iterable[int], fault_s: float) -> float:
    """Return how long after a fault the first time is [s], NaN if none is."""
    since_s = (time_ns / NS_PER_S - fault_s for time_ns in times_ns)
    return next((each_s for each_s in since_s if each_s >= 0.0), nan)


TICKS_MAX = 10_000_000


def run_on_nodes(pair: Pair, rules: VerdictRules, row: FloatArray) -> RunEnd:
    """Write the results of one run into ``row``, shape (columns,).

    Without a bus the wire takes no time. The noise and the rest bus are drawn from the plant's
    seed. Raises SettingsError.
    """
    nodes, watch = _ran(pair)
    plant, controller, report = nodes.plant, nodes.controller, nodes.plant.report()
    downlink, uplink = report["downlink"], report["uplink"]
    motion = PlantTable.of_samples(plant.samples)
    if not (len(motion.time_s) and downlink["released"] and uplink["released"]):
        row[COUNTED] = 0.0
        return RunEnd.NO_START
    is_outside = np.abs(motion.lateral_error_m) > RANGE_M
    has_left = bool(is_outside.any())
    if has_left:
        last = int(np.argmax(is_outside))
        motion = PlantTable._make(column[: last + 1] for column in motion)
    sent_rad = np.array(watch.sent_rad)
    if isinstance(controller, ControllerNode):
        sent_rad = np.array([sample.sent_steer_rad for sample in controller.samples])
    at = motion.arc_length_m, motion.heading_error_rad, motion.lateral_error_m
    behind_m = rules.behind_preview_m(pair.plant.vehicle)
    known = {
        0.0: motion.lateral_error_m,
        pair.plant.vehicle.preview_distance_m: motion.cg_deviation_m,
    }
    judged_m = known.get(behind_m)
    if judged_m is None:
        rows = zip(*(column.tolist() for column in at), strict=True)
        judged_m = np.array(
            [cg_deviation_m(plant.path, at_m, psi, y_m, behind_m) for at_m, psi, y_m in rows]
        )
    moved = motion.time_s, motion.lateral_error_m, motion.cg_deviation_m, judged_m
    figures = figures_of(
        rules, pair.plant, pair.controller, *moved, motion.wheel_angle_rad, sent_rad
    )._replace(
        **latency_figures(motion.downlink_latency_s)._asdict(),
        outside_m=farthest_outside_m(pair.plant, *at),
        beyond_lane_m=nan if report["beyond_lane_m"] is None else report["beyond_lane_m"],
        grip_used_s=nan if report["grip_used"] is None else report["grip_used"]["from_s"],
        **watch.reactions(nodes.edge.report().get("faults", ())),
    )
    row[: len(figures)] = figures
    lost = downlink["lost"], uplink["lost"]
    row[COUNTED] = (len(motion.time_s), len(sent_rad), downlink["released"], *lost)
    if isinstance(nodes.hand_wheel, HandWheelNode):
        row[COUNTED.stop :] = _wheel_figures(pair, nodes.hand_wheel, watch)
    if has_left or report["failure"]:  # the plant's own: a car that has left its path
        return RunEnd.LEFT_RANGE
    return RunEnd.CONTROLLER_FAILED if controller.report()["failure"] else RunEnd.COMPLETE


def _wheel_figures(pair: Pair, node: HandWheelNode, watch: ReactionWatch) -> HandWheelFigures:
    """Return the figures; without a bus the network alone decides the felt delay."""
    plant, wheel, felt_s = pair.plant, pair.hand_wheel, nan
    lines = plant.latency.downlink, plant.latency.uplink
    if wheel is not None and pair.bus is not None and not plant.faults:
        frames, reads = watch.frames, FEEDBACK_LAWS[wheel.feedback.law].reads
        roads = frames[reads] if reads else ()
        felt_s = felt_delay_on_bus_s(plant, wheel, frames[messages.HandWheelState], roads)
    elif wheel is not None and pair.bus is None and not any(it.has_trace for it in lines):
        events = schedule_run(plant, pair.controller, wheel).wheel
        felt_s = nan if events is None else felt_delay_s(plant, wheel, events)
    return HandWheelFigures(*(node.shaking or ()))._replace(felt_delay_s=felt_s)


def _ran(pair: Pair) -> tuple[VirtualPair[ControllerNode | LockstepNode], ReactionWatch]:
    """Return the nodes after their run, and who watched their bus."""
    bus = None if pair.bus is None else shared_bus(pair.bus, pair.plant.seed)
    language = read_language(pair.dialect)
    listening, watch = language.listening(), ReactionWatch()

    def on_wire(time_ns: int, _sender: int, frame: Frame) -> None:
        for ours in listening.hear(frame, time_ns).ours:
            decoded = messages.decode(ours)
            if isinstance(decoded, messages.Decoded):
                if pair.hand_wheel is not None:
                    watch.frames[type(decoded.message)].append((decoded.counter, time_ns))
                watch.on_message(time_ns, decoded.message)

    with controller_node(pair.command or pair.controller, TICKS_MAX) as controller:
        wheel = None if pair.hand_wheel is None else HandWheelNode(pair.hand_wheel, 0)
        nodes = pair_with(pair.plant, controller, language=language, hand_wheel=wheel)
        nodes.run(bus, on_wire=on_wire)
    return nodes, watch
