"""Runs of a study over a bus: the two nodes in virtual time.

Compiled runs have a wire that takes no time. Where a study has a bus, with its bit rate, rest bus,
errors and clocks, the nodes themselves run on it, some thousand times slower. There the controller
may be a program in lockstep: its commands are known from the bus.
"""

from collections.abc import Iterable, Mapping
from itertools import repeat
from math import nan
from typing import Any, NamedTuple

import numpy as np

from ...controller.node.node import ControllerNode
from ...dbc import messages
from ...dbc.bus_language import read_language
from ...dbc.messages import Freshness, Mode, SafetyState, SteeringStatusCode
from ...hand_wheel.node import HandWheelNode
from ...plant_emulator.evaluation.run_verdict import RANGE_M, RunEnd, VerdictRules
from ...plant_emulator.node.node import PlantNode
from ...plant_emulator.path.cg_deviation import cg_deviation_m
from ...plant_emulator.path.path import Path
from ...plant_emulator.settings import PlantSettings
from ...runtime.array_types import FloatArray
from ...runtime.frame import Frame
from ...runtime.node import NS_PER_S
from ..compiled.hand_wheel_events import felt_delay_s
from ..compiled.schedule import schedule_run
from ..lockstep.node import LockstepNode, controller_node
from ..pair.pair_result import Trace
from ..pair.virtual_bus import shared_bus
from ..pair.virtual_pair import pair_with
from .compiled_figures import (
    COUNTED,
    BodyFigures,
    FigureRules,
    Figures,
    HandWheelFigures,
    farthest_outside_m,
    figures_of,
    latency_figures,
    rules_of,
)
from .scenario import Pair

_LEFT_MODES = (Mode.HOLDING, Mode.SAFE_STOP)
_LEFT_CODES = (
    SteeringStatusCode.HOLDING,
    SteeringStatusCode.FALLBACK,
    SteeringStatusCode.SAFE_STATE,
)


class Reactions(NamedTuple):
    """Times of one run [s]; NaN for what did not happen.

    ``fault_s``     the first frame that a fault changed, from the run's start
    ``reported_s``  from then until it was reported on the bus
    ``reaction_s``  from then until a node left control
    """

    fault_s: float
    reported_s: float
    reaction_s: float


class ReactionWatch:
    """Watches the messages of a run, in their order on the bus, whatever the controller is.

    A report is a count of CONTROLLER_SAFETY or PLANT_STATUS that rises, a message that is stale, or
    a state that is not normal. Control is left by a command whose mode is not ACTIVE, or by a
    steering that holds its wheel. Where the network itself loses frames, such a report may be of
    that.
    """

    def __init__(self) -> None:
        self._reported_ns: list[int] = []
        self._left_ns: list[int] = []
        self._counts: dict[type, tuple[int, ...]] = {}

    def on_message(self, time_ns: int, message: messages.Message) -> None:
        """Take a message."""
        match message:
            case messages.SteeringCommand() | messages.SteeringPlan():
                if message.mode in _LEFT_MODES:
                    self._left_ns.append(time_ns)
            case messages.SteeringStatus():
                if message.status in _LEFT_CODES:
                    self._left_ns.append(time_ns)
            case messages.ControllerSafety():
                is_stale = Freshness.STALE in (
                    message.lateral_error_freshness,
                    message.steering_status_freshness,
                    message.vehicle_state_freshness,
                )
                self._report(time_ns, message, (message.rejected, message.lost), is_wrong=is_stale)
            case messages.PlantStatus():
                is_wrong = message.safety is not SafetyState.NORMAL
                self._report(time_ns, message, (message.rejected,), is_wrong=is_wrong)

    def reactions(self, faults: Iterable[Mapping[str, Any]]) -> Reactions:
        """Return the times, of the plant's report on each of its faults."""
        known_s = [fault["first_s"] for fault in faults if fault["first_s"] is not None]
        if not known_s:
            return Reactions(nan, nan, nan)
        fault_s = min(known_s)
        events = self._reported_ns, self._left_ns
        return Reactions(fault_s, *(_first_s(times_ns, fault_s) for times_ns in events))

    def _report(
        self, time_ns: int, message: messages.Message, counts: tuple[int, ...], *, is_wrong: bool
    ) -> None:
        before = self._counts.get(type(message), counts)
        self._counts[type(message)] = counts
        if is_wrong or counts != before:
            self._reported_ns.append(time_ns)


def _first_s(times_ns: Iterable[int], fault_s: float) -> float:
    """Return how long after a fault the first time is [s], NaN if none is."""
    since_s = (time_ns / NS_PER_S - fault_s for time_ns in times_ns)
    return next((each_s for each_s in since_s if each_s >= 0.0), nan)


TICKS_MAX = 10_000_000


class Ran(NamedTuple):
    """Both nodes after their run over a bus.

    ``sent_rad``   the commands on the bus; a car's names none
    ``reactions``  to the faults of the plant's settings
    """

    plant: PlantNode
    controller: ControllerNode | LockstepNode
    sent_rad: list[float]
    reactions: Reactions
    wheel: HandWheelNode | None


def run_on_nodes(pair: Pair, rules: VerdictRules, row: FloatArray) -> RunEnd:
    """Write the results of one run into ``row``, shape (columns,).

    Without a bus the wire takes no time. The noise and the rest bus are drawn from the plant's
    seed. Raises SettingsError.
    """
    plant, controller, sent_on_bus_rad, reactions, wheel = _ran(pair)
    trace, report = Trace.of_node(plant), plant.report()
    if not len(trace.time_s) or not report["downlink"]["released"]:
        row[COUNTED] = 0.0
        return RunEnd.NO_START
    has_left, samples = range_left(trace)
    if isinstance(controller, ControllerNode):
        sent_rad = np.array([sample.sent_steer_rad for sample in controller.samples])
    else:
        sent_rad = np.array(sent_on_bus_rad)
    run_rules = rules_of(rules, pair.plant, pair.controller)
    beyond_m, grip = report["beyond_lane_m"], report["grip_used"]
    at = trace.arc_length_m, trace.heading_error_rad, trace.lateral_error_m
    body = BodyFigures(
        farthest_outside_m(pair.plant, *(column[:samples] for column in at)),
        nan if beyond_m is None else beyond_m,
        nan if grip is None else grip["from_s"],
    )
    figures = figures_of_trace(run_rules, pair.plant, plant.path, trace, samples, sent_rad, body)
    row[: len(figures)] = figures._replace(**reactions._asdict())
    downlink, uplink = report["downlink"], report["uplink"]
    lost = downlink["lost"], uplink["lost"]
    row[COUNTED] = (samples, len(sent_rad), downlink["released"], *lost)
    if wheel is not None:
        row[COUNTED.stop :] = _wheel_figures(pair, wheel)
    if has_left or report["failure"]:  # the plant's own: a car that has left its path
        return RunEnd.LEFT_RANGE
    return RunEnd.CONTROLLER_FAILED if controller.report()["failure"] else RunEnd.COMPLETE


def _wheel_figures(pair: Pair, node: HandWheelNode) -> HandWheelFigures:
    """Return the figures; the network alone decides the felt delay."""
    lines, felt_s = (pair.plant.latency.downlink, pair.plant.latency.uplink), nan
    if pair.hand_wheel is not None and pair.bus is None and not any(it.has_trace for it in lines):
        events = schedule_run(pair.plant, pair.controller, pair.hand_wheel).wheel
        felt_s = nan if events is None else felt_delay_s(pair.plant, pair.hand_wheel, events)
    return HandWheelFigures.of(node.shaking, felt_s)


def range_left(trace: Trace) -> tuple[bool, int]:
    """Return whether the error left the range of the wire, and how many samples there are to it."""
    outside = np.abs(trace.lateral_error_m) > RANGE_M
    has_left = bool(outside.any())
    return has_left, int(np.argmax(outside)) + 1 if has_left else len(outside)


def _deviation_m(path: Path, trace: Trace, behind_m: float) -> FloatArray:
    """Return the deviation of a point behind the preview point at every sample of a trace."""
    columns = (trace.arc_length_m, trace.heading_error_rad, trace.lateral_error_m)
    at_m, heading_rad, error_m = (column.tolist() for column in columns)
    errors_m = map(cg_deviation_m, repeat(path), at_m, heading_rad, error_m, repeat(behind_m))
    return np.fromiter(errors_m, np.float64, len(error_m))


def figures_of_trace(
    rules: FigureRules,
    plant: PlantSettings,
    path: Path,
    trace: Trace,
    samples: int,
    sent_rad: FloatArray,
    body: BodyFigures,
) -> Figures:
    """Return the figures of the first samples of a trace; ``sent_rad`` one a control period."""
    known = {0.0: trace.lateral_error_m, plant.vehicle.preview_distance_m: trace.cg_deviation_m}
    judged_m = known.get(rules.behind_preview_m)
    if judged_m is None:
        judged_m = _deviation_m(path, trace, rules.behind_preview_m)
    errors_m = trace.lateral_error_m, trace.cg_deviation_m, judged_m
    error_m, cg_m, judged_m, time_s, wheel_rad = (
        np.ascontiguousarray(column[:samples])
        for column in (*errors_m, trace.time_s, trace.wheel_angle_rad)
    )
    moved = error_m, cg_m, judged_m, wheel_rad
    latency = latency_figures(trace.downlink_latency_s[:samples])
    return figures_of(rules, time_s, *moved, sent_rad, latency, body)


def _ran(pair: Pair) -> Ran:
    bus = None if pair.bus is None else shared_bus(pair.bus, pair.plant.seed)
    language = read_language(pair.dialect)
    listening = language.listening()
    sent_rad: list[float] = []
    watch = ReactionWatch()

    def on_wire(time_ns: int, _sender: int, frame: Frame) -> None:
        for ours in listening.hear(frame, time_ns).ours:
            decoded = messages.decode(ours)
            if isinstance(decoded, messages.Decoded):
                watch.on_message(time_ns, decoded.message)
                if isinstance(decoded.message, messages.SteeringCommand):
                    sent_rad.append(decoded.message.steer_rad)

    with controller_node(pair.command or pair.controller, TICKS_MAX) as controller:
        wheel = None if pair.hand_wheel is None else HandWheelNode(pair.hand_wheel, 0)
        nodes = pair_with(pair.plant, controller, language=language, hand_wheel=wheel)
        nodes.run(bus, on_wire=on_wire)
    reactions = watch.reactions(nodes.edge.report().get("faults", ()))
    return Ran(nodes.plant, controller, sent_rad, reactions, wheel)
