"""Faults of frames, what must detect each of them, and runs of a pair that meets one."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from steer_by_wire.closed_loop.pair.virtual_bus import QUIET_BUS, virtual_bus
from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc.messages import MESSAGE_TYPES
from steer_by_wire.plant_emulator.faults.settings import (
    MESSAGES_OF,
    SIGNAL_FAULTS,
    FaultDirection,
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
    """Both nodes after a run; ``edge`` is the plant behind its faults."""

    plant: Counting
    edge: ReportingNode
    controller: Counting
    frames: Sequence[Frame]


def run_with(
    faults: Sequence[FaultSettings], controller: ReportingNode | str, plant: Sequence[str] = ()
) -> FaultyRun:
    """Run a controller, or one of a preset, with a plant that has these faults."""
    if isinstance(controller, str):
        controller = ControllerNode(controller_preset(controller), 0)
    settings = plant_preset("paper_nominal", (f"duration_s={MOTION_S}", *plant))
    watched = Counting(PlantNode(settings, 0)), Counting(controller)
    edge = with_faults(watched[0], faults, settings.seed)
    frames: list[Frame] = []
    executor = VirtualTimeExecutor(
        (edge, watched[1]),
        virtual_bus(QUIET_BUS, settings.seed),
        lambda _time_ns, _sender, frame: frames.append(frame),
    )
    executor.run(round((MOTION_S + 0.2) * NS_PER_S))
    return FaultyRun(watched[0], edge, watched[1], frames)
