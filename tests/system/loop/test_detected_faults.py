"""Every kind of fault is detected by what must detect it, and answered within its time.

The times are those of virtual time. Rules that need another run have their own tests: missed
periods (``test_self_supervision``), a silent peer in real processes (``test_two_processes``).
"""

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, NamedTuple

import pytest

from steer_by_wire.closed_loop.pair.virtual_bus import QUIET_BUS, virtual_bus
from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc.messages import (
    CAN_IDS,
    MESSAGE_TYPES,
    Decoded,
    Mode,
    SteeringCommand,
    SteeringStatus,
    SteeringStatusCode,
    decode,
)
from steer_by_wire.plant_emulator.faults.settings import (
    MESSAGES_OF,
    SIGNAL_FAULTS,
    STEERING_FAULTS,
    FaultDirection,
    FaultKind,
    FaultSettings,
)
from steer_by_wire.plant_emulator.faults.stage import with_faults
from steer_by_wire.plant_emulator.node.node import PlantNode
from steer_by_wire.plant_emulator.settings import plant_preset
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node import NS_PER_S, ReportingNode, Wrapper
from steer_by_wire.runtime.node.virtual_time_loop import VirtualTimeExecutor

ONSET_S, FAULT_S, MOTION_S = 1.5, 0.8, 4.0
"""From the fallback's end at 0 rad the target ramps for 1.3 s to the 0.25 rad wanted by then."""
_ONSET_NS = round(ONSET_S * NS_PER_S)
_WATCHED_NS = 500_000_000
"""Time from the onset on in which counts are read after every tick."""
_STALE = ("steering_status", "vehicle_state")
"""Messages whose age makes no node leave control."""


class Case(NamedTuple):
    """A fault of one message, and what must count it.

    ``counts``  any of these names; "counter" stands for every verdict of the E2E counter, none for
                a fault that nothing can detect
    ``leaves``  whether the receiver has nothing left to act on and leaves control; None: it may
    """

    kind: str
    message: str
    magnitude: float
    counts: tuple[str, ...] = ()
    leaves: bool | None = False

    @property
    def settings(self) -> FaultSettings:
        """The fault, at the time that all have."""
        is_down = MESSAGE_TYPES[self.message] in MESSAGES_OF[FaultDirection.DOWNLINK]
        return FaultSettings(
            kind=self.kind,
            direction="downlink" if is_down else "uplink",
            message=self.message,
            signal=MESSAGE_TYPES[self.message]._fields[0] if self.kind in SIGNAL_FAULTS else None,
            onset_s=ONSET_S,
            duration_s=FAULT_S,
            magnitude=self.magnitude,
        )


ERROR, COMMAND, STATUS, STATE = (
    "LATERAL_ERROR", "STEERING_COMMAND", "STEERING_STATUS", "VEHICLE_STATE",
)  # fmt: skip
DETECTED = (
    *(Case("drop", message, 1.0, ("held",), leaves=True) for message in (ERROR, COMMAND)),
    *(Case("drop", message, 1.0, ("stale",)) for message in (STATUS, STATE)),
    *(Case("drop", message, 0.5, ("counter",)) for message in (ERROR, COMMAND, STATUS)),
    *(Case("burst_loss", message, 5, ("counter",)) for message in (ERROR, COMMAND)),
    *(Case("duplicate", message, 1.0, ("counter",)) for message in (ERROR, COMMAND)),
    *(Case("reorder", message, 2, ("counter",)) for message in (ERROR, COMMAND)),
    *(Case("delay_spike", message, 0.3, ("held",), leaves=True) for message in (ERROR, COMMAND)),
    *(Case("delay_spike", message, 0.3, ("stale",)) for message in (STATUS, STATE)),
    *(Case("freeze", message, 1.0, ("counter",), leaves=True) for message in (ERROR, COMMAND)),
    *(Case("freeze", message, 1.0, ("counter",)) for message in (STATUS, STATE)),
    *(Case("bit_flips", message, 0.5, ("bad_crc",), leaves=True) for message in (ERROR, COMMAND)),
    *(Case("bit_flips", message, 0.005, ("bad_crc",)) for message in (ERROR, COMMAND, STATUS)),
    *(Case("wrong_length", message, 7, ("wrong_length",), True) for message in (ERROR, COMMAND)),
    Case("wrong_identifier", ERROR, 1.0, ("masqueraded",), leaves=True),
    Case("wrong_identifier", COMMAND, 1.0, ("held",), leaves=True),
    Case("wrong_identifier", STATE, 1.0, ("masqueraded",)),
    *(Case("spoof", message, 0.2, ("counter",), leaves=None) for message in (ERROR, COMMAND)),
    *(Case("replay", message, 0.4, ("counter",), leaves=None) for message in (ERROR, COMMAND)),
    Case("out_of_range", ERROR, 1.0, ("not_available",), leaves=True),
    Case("out_of_range", COMMAND, 1.0, ("out_of_range",), leaves=True),
    *(Case("out_of_range", message, 1.0, ("out_of_range",)) for message in (STATUS, STATE)),
    Case("offset", COMMAND, 1.0, ("limited",)),
    Case("noise", COMMAND, 4.0, ("limited",)),
)
UNDETECTED = (
    *(Case("stuck", message, 1.0) for message in (ERROR, COMMAND)),
    *(Case("offset", message, 0.03) for message in (ERROR, COMMAND)),
    *(Case("scale", message, 0.5) for message in (ERROR, COMMAND)),
    *(Case("drift", message, 0.03) for message in (ERROR, COMMAND)),
    Case("noise", ERROR, 0.02),
)
"""A plausible value with a valid CRC and counter."""
UNRECEIVED = (
    *(Case("drop", name, 1.0) for name in ("CONTROLLER_STATUS", "DELAY_STATUS", "PLANT_STATUS")),
    Case("freeze", "CONTROLLER_SAFETY", 1.0),
    Case("bit_flips", "PLANT_STATUS", 0.5),
    Case("spoof", "DELAY_STATUS", 0.0),
)
"""No node receives these messages."""
_PROTOCOL = frozenset(
    ["bad_crc", "masqueraded", "wrong_length", "wrong_format", "out_of_range", "not_available"]
)


def counts_of(report: Mapping[str, Any]) -> dict[str, int]:
    """Return what the report of either node counts of faults: those that are not 0."""
    rejected = report["rejected"]
    counts = {name: rejected.get(name, 0) for name in _PROTOCOL}
    counts["counter"] = sum(rejected.values()) - sum(counts.values())
    if "safety" in report:
        counts["counter"] += report["lost_on_the_bus"]
        counts["held"] = report["safety"]["holdings"]
        counts["limited"] = sum(report["safety"]["interventions"].values())
    else:
        counts["counter"] += report["lost"]
        counts["held"] = report["holds"]
        counts["stale"] = sum(report["stale"][name] for name in _STALE)
    return {name: count for name, count in counts.items() if count}


class Counting(Wrapper[ReportingNode]):
    """A node whose counts are read from the onset on: ``first_ns`` is when each first rose [ns]."""

    def __init__(self, node: ReportingNode) -> None:
        super().__init__(node)
        self.first_ns: dict[str, int] = {}

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        """Let the node tick, and read its counts."""
        sent = self.node.on_tick(now_ns)
        if 0 <= now_ns - _ONSET_NS <= _WATCHED_NS:
            for name in counts_of(self.node.report()):
                self.first_ns.setdefault(name, now_ns)
        return sent


class FaultyRun(NamedTuple):
    """Both nodes after a run, the receiver counting; ``edge`` is the plant behind its faults."""

    plant: ReportingNode
    edge: ReportingNode
    controller: ReportingNode
    frames: Sequence[Frame]


def run_with(
    faults: Sequence[FaultSettings], controller: ReportingNode | str, plant: Sequence[str] = ()
) -> FaultyRun:
    """Run a controller, or one of a preset, with a plant that has these faults."""
    if isinstance(controller, str):
        controller = ControllerNode(controller_preset(controller), 0)
    settings = plant_preset("paper_nominal", (f"duration_s={MOTION_S}", *plant))
    node: ReportingNode = PlantNode(settings, 0)
    if any(fault.direction == "downlink" for fault in faults):
        node = Counting(node)
    else:
        controller = Counting(controller)
    edge = with_faults(node, faults, settings.seed)
    frames: list[Frame] = []
    executor = VirtualTimeExecutor(
        (edge, controller),
        virtual_bus(QUIET_BUS, settings.seed),
        lambda _time_ns, _sender, frame: frames.append(frame),
    )
    executor.run(round((MOTION_S + 0.2) * NS_PER_S))
    return FaultyRun(node, edge, controller, frames)


FTTI_S = 0.15
"""The fault tolerant time interval of both nodes' settings."""
LATENCY_S = 0.05
DELAYED = (f"latency.downlink.mean_s={LATENCY_S}", "latency.uplink.mean_s=0.03")
LOSING = ("bit_flips", "wrong_length", "wrong_identifier", "out_of_range", "drop")
"""Kinds after which a frame that they have changed must not be used."""


def ids(case: Case) -> str:
    return f"{case.kind} {case.message} {case.magnitude:g}"


@cache
def golden(law: str = "practical_pd_ddob", plant: Sequence[str] = ()) -> FaultyRun:
    return run_with((), law, plant)


@cache
def faulty(case: Case, law: str = "practical_pd_ddob", plant: Sequence[str] = ()) -> FaultyRun:
    return run_with([case.settings], law, plant)


def newest(frames: Sequence[Frame], kind: type) -> object:
    """The last message of a kind on the bus."""
    data = next(frame for frame in reversed(frames) if frame.can_id == CAN_IDS[kind])
    decoded = decode(data)
    assert isinstance(decoded, Decoded)
    return decoded.message


def assert_detected(case: Case, run: FaultyRun, latency_s: float = 0.0) -> None:
    """Demand a count within the FTTI of the first frame that the fault changed."""
    is_down = case.settings.direction == "downlink"
    receiver = run.plant if is_down else run.controller
    assert isinstance(receiver, Counting)
    effect_s = run.edge.report()["faults"][0]["first_s"]
    since_s = {name: 1e-9 * at_ns - effect_s for name, at_ns in receiver.first_ns.items()}
    # What the actuator has is affected one latency after the frame on the bus.
    limit_s = FTTI_S + latency_s * is_down
    assert min(since_s.values()) > -1e-3, "nothing is counted before the fault"
    assert min(since_s[name] for name in case.counts if name in since_s) <= limit_s
    if case.leaves:
        assert since_s["held"] <= limit_s
    elif case.leaves is not None:
        assert "held" not in since_s


@pytest.mark.parametrize("case", DETECTED, ids=ids)
def test_it_is_counted_and_answered_in_time(case: Case) -> None:
    assert_detected(case, faulty(case))


@pytest.mark.parametrize("case", [case for case in DETECTED if case.leaves], ids=ids)
def test_so_it_is_behind_a_network(case: Case) -> None:
    assert_detected(case, faulty(case, "practical_predictor", DELAYED), LATENCY_S)


@pytest.mark.parametrize("case", [*DETECTED, *UNDETECTED], ids=ids)
def test_both_nodes_are_in_control_again_after_it(case: Case) -> None:
    frames = faulty(case).frames
    command, status = newest(frames, SteeringCommand), newest(frames, SteeringStatus)
    assert isinstance(command, SteeringCommand)
    assert isinstance(status, SteeringStatus)
    assert (command.mode, status.status) == (Mode.ACTIVE, SteeringStatusCode.APPLYING)


@pytest.mark.parametrize(
    "case", [case for case in DETECTED if case.kind in LOSING and case.counts != ("held",)], ids=ids
)
def test_no_changed_frame_is_used(case: Case) -> None:
    receiver = "plant" if case.settings.direction == "downlink" else "controller"
    accepted = [getattr(run, receiver).report()["accepted"] for run in (golden(), faulty(case))]
    assert accepted[0] - accepted[1] == faulty(case).edge.report()["faults"][0]["changed"]


@pytest.mark.parametrize("case", UNDETECTED, ids=ids)
def test_what_nothing_can_detect_is_not_counted(case: Case) -> None:
    run = faulty(case)
    assert run.edge.report()["faults"][0]["changed"] > 0
    assert counts_of(run.plant.report()) == counts_of(run.controller.report()) == {}


@pytest.mark.parametrize("case", UNRECEIVED, ids=ids)
def test_a_fault_of_a_message_that_no_node_receives_changes_no_command(case: Case) -> None:
    run, command = faulty(case), CAN_IDS[SteeringCommand]
    assert run.edge.report()["faults"][0]["changed"] > 0
    assert counts_of(run.plant.report()) == counts_of(run.controller.report()) == {}
    with_fault, without = (
        [frame for frame in one.frames if frame.can_id == command] for one in (run, golden())
    )
    assert with_fault == without


@pytest.mark.parametrize(
    ("law", "plant"), [("practical_pd_ddob", ()), ("practical_predictor", DELAYED)]
)
def test_without_a_fault_nothing_is_counted(law: str, plant: Sequence[str]) -> None:
    run = golden(law, plant)
    assert counts_of(run.plant.report()) == counts_of(run.controller.report()) == {}


def test_every_kind_is_among_the_cases() -> None:
    assert {case.kind for case in (*DETECTED, *UNDETECTED)} == set(FaultKind) - STEERING_FAULTS
