"""Watches a node from outside: its own counters over time, and what it puts on the bus."""

import math
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

from ....controller.settings import ControllerSettings
from ....dbc import messages
from ....plant_emulator.settings import PlantSettings
from ....plant_emulator.steering.plan_buffer import PLAN_VALUES
from ....runtime.frame import Frame
from ....runtime.node import ReportingNode, Wrapper

SAFE_CAUSES = ("silence", "failure", "safe_state")
"""Counts that rise when a node leaves control."""
_STALE_WITHOUT_HOLD = ("steering_status", "vehicle_state")
COMMAND_IDS = frozenset(
    (messages.CAN_IDS[messages.SteeringCommand], messages.CAN_IDS[messages.SteeringPlan])
)
_RESOLUTION_RAD = messages.resolutions(messages.SteeringCommand)["steer_rad"]
HELD_MODES = (messages.Mode.HOLDING, messages.Mode.SAFE_STOP)
HELD_CODES = (messages.SteeringStatusCode.HOLDING, messages.SteeringStatusCode.FALLBACK)
_ABNORMAL_CODES = (*HELD_CODES, messages.SteeringStatusCode.SAFE_STATE)
REPORTING_CODES = (*_ABNORMAL_CODES, messages.SteeringStatusCode.LIMITED_BY_SAFETY)
"""Codes that report a fault; a wheel that is limited, or faded in, is under control."""
REPORTING_SAFETY = frozenset(messages.SafetyState) - {messages.SafetyState.NORMAL}


class Bounds(NamedTuple):
    """What no frame of a node may exceed: angles, and the change from command to command [rad].

    ``plan_step_rad``  from sample to sample of a plan
    """

    command_rad: float
    command_step_rad: float
    plan_step_rad: float
    wheel_rad: float


def bounds_of(plant: PlantSettings, controller: ControllerSettings) -> Bounds:
    """Return the bounds that the settings promise, with a step of the wire's resolution."""
    limits = controller.steer_limits
    angle = plant.safety.angle_rad_max
    return Bounds(
        limits.steer_rad_max + _RESOLUTION_RAD,
        limits.step_rad_max + _RESOLUTION_RAD,
        limits.step_rad_max * plant.sensor_period_ns / controller.period_ns + _RESOLUTION_RAD,
        (math.inf if isinstance(angle, str) else angle) + _RESOLUTION_RAD,
    )


def counts_of(report: Mapping[str, Any]) -> dict[str, int]:
    """Return what either node's report counts of faults, by cause."""
    counts = {**report["rejected"], "lost": report.get("lost_on_the_bus", report.get("lost"))}
    safety = report.get("safety")
    if safety is not None:
        counts["silence"] = safety["holdings"]
        counts["intervention"] = sum(safety["interventions"].values())
        counts["safe_state"] = int(safety["safe_state"] is not None)
    else:
        counts["silence"] = report["holds"]
        counts["stale"] = sum(report["stale"][name] for name in _STALE_WITHOUT_HOLD)
        counts["failure"] = int(bool(report["failure"]))
        counts["law_failures"] = report["law_failures"]
        counts["skipped_ticks"] = report["skipped_ticks"]
    return counts


class Watch(Wrapper[ReportingNode]):
    """Stands in the place of a node, and records what it does.

    ``onset_ns``  from when its counters are read after every frame and tick [ns]
    ``wanted``    causes of which one has to be counted, and then one that leaves control if
                  ``until_safe``, before its counters are no longer read
    ``peer_sent`` filled by the peer's watch: frames in their true form; others are corrupted

    ``expect_false`` announces frames that a fault has made of others. ``commands`` and ``statuses``
    are what it has sent, ``started_ns`` when it was handed the first command, ``false_ns`` when it
    has accepted a false frame [ns].
    """

    def __init__(
        self,
        node: ReportingNode,
        bounds: Bounds,
        onset_ns: int,
        wanted: Collection[str],
        until_safe: bool,
        peer_sent: Collection[Frame] | None,
    ) -> None:
        super().__init__(node)
        self._bounds = bounds
        self._onset_ns = onset_ns
        self._wanted = frozenset(wanted)
        self._until_safe = until_safe
        self._peer_sent = peer_sent
        self._before: dict[str, int] | None = None
        self._is_done = not wanted
        self.sent: set[Frame] = set()
        self.first_seen_ns: dict[str, int] = {}
        self.corrupted = 0
        self.corrupted_accepted = 0
        self.invalid: list[str] = []
        self.states: list[tuple[int, bool]] = []
        self.reported_ns: list[int] = []
        self._rejected: int | None = None
        self._last_command: messages.SteeringCommand | None = None
        self._false: Counter[Frame] = Counter()
        self.false_frames = 0
        self.false_ns: list[int] = []
        self.commands: list[tuple[int, messages.SteeringCommand]] = []
        self.statuses: list[tuple[int, messages.SteeringStatus]] = []
        self.started_ns: int | None = None

    def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:
        """Hand over a frame, and read the node's counters."""
        self._begin(now_ns)
        if frame.can_id in COMMAND_IDS and self.started_ns is None:
            self.started_ns = now_ns
        is_false = self._false[frame] > 0
        is_corrupted = self._peer_sent is not None and frame not in self._peer_sent
        if not is_false and not is_corrupted:
            answers = self.node.on_frame(frame, now_ns)
        else:
            accepted = self.node.report()["accepted"]
            answers = self.node.on_frame(frame, now_ns)
            is_accepted = self.node.report()["accepted"] > accepted
            self._false[frame] -= is_false
            self.false_ns += [now_ns] * (is_false and is_accepted)
            self.corrupted += is_corrupted
            self.corrupted_accepted += is_corrupted and is_accepted
        self._look(now_ns)
        return self._noted(answers, now_ns)

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        """Let the node tick, and read its counters."""
        self._begin(now_ns)
        sent = self.node.on_tick(now_ns)
        self._look(now_ns)
        return self._noted(sent, now_ns)

    def expect_false(self, sent: Frame, frames: Sequence[Frame]) -> None:
        """Record frames on the way to the node that differ from what their sender has just sent."""
        for frame in frames:
            if frame != sent:
                self._false[frame] += 1
                self.false_frames += 1

    def counted(self) -> dict[str, int]:
        """Return how far each count has risen since the onset, those that have."""
        before, counts = self._before or {}, counts_of(self.node.report())
        risen = {cause: count - before.get(cause, 0) for cause, count in counts.items()}
        return {cause: count for cause, count in sorted(risen.items()) if count}

    def _begin(self, now_ns: int) -> None:
        if self._before is None and now_ns >= self._onset_ns:
            self._before = counts_of(self.node.report())

    def _look(self, now_ns: int) -> None:
        """Record which counters have risen for the first time."""
        if self._is_done or self._before is None:
            return
        for cause, count in counts_of(self.node.report()).items():
            if count > self._before.get(cause, 0):
                self.first_seen_ns.setdefault(cause, now_ns)
        seen = self.first_seen_ns.keys()
        is_safe = not self._until_safe or any(cause in seen for cause in SAFE_CAUSES)
        self._is_done = is_safe and bool(self._wanted & seen)

    def _noted(self, frames: Sequence[Frame], now_ns: int) -> Sequence[Frame]:
        for frame in frames:
            self.sent.add(frame)
            decoded = messages.decode(frame)
            if isinstance(decoded, messages.Decoded):
                self._check(decoded.message, now_ns)
            elif decoded is not messages.Rejection.NOT_AVAILABLE:
                self.invalid.append(f"{decoded} under 0x{frame.can_id:03X}")
        return frames

    def _check(self, message: object, now_ns: int) -> None:
        """Check a message against the bounds, and record whether its sender is in control."""
        if isinstance(message, messages.SteeringCommand):
            if abs(message.steer_rad) > self._bounds.command_rad:
                self.invalid.append(f"command of {message.steer_rad:g} rad")
            self._check_step(message)
            self.commands.append((now_ns, message))
            self._note_state(now_ns, message.mode in HELD_MODES)
        elif isinstance(message, messages.SteeringPlan):
            self._check_plan(message)
            first = messages.SteeringCommand(message.steer_0_rad, message.plan_number, message.mode)
            self.commands.append((now_ns, first))
            self._note_state(now_ns, message.mode in HELD_MODES)
        elif isinstance(message, messages.SteeringStatus):
            if abs(message.wheel_angle_rad) > self._bounds.wheel_rad:
                self.invalid.append(f"wheel at {message.wheel_angle_rad:g} rad")
            self.statuses.append((now_ns, message))
            self._note_report(now_ns, message.status in REPORTING_CODES)
            self._note_state(now_ns, message.status in _ABNORMAL_CODES)
        elif isinstance(message, messages.ControllerSafety):
            is_stale = messages.Freshness.STALE in message[2:5]
            is_wrong = is_stale or message.fault is not messages.ControllerFault.NONE
            refused = message.rejected + message.lost
            self._note_report(now_ns, is_wrong or self._has_refused(refused))
        elif isinstance(message, messages.PlantStatus):
            is_wrong = message.safety in REPORTING_SAFETY
            self._note_report(now_ns, is_wrong or self._has_refused(message.rejected))

    def _check_step(self, command: messages.SteeringCommand) -> None:
        """Check the change since the last command that got out against the rate limit."""
        last, self._last_command = self._last_command, command
        if last is None:
            return
        steps = (command.command_counter - last.command_counter) % messages.COMMAND_COUNTERS
        change_rad = command.steer_rad - last.steer_rad
        if abs(change_rad) > steps * self._bounds.command_step_rad:
            self.invalid.append(f"command steps by {change_rad:g} rad in {steps} periods")

    def _check_plan(self, plan: messages.SteeringPlan) -> None:
        self._last_command = None  # which of the angles acts at its time is not on the wire
        angles_rad = plan[-PLAN_VALUES:]
        if max(map(abs, angles_rad)) > self._bounds.command_rad:
            self.invalid.append(f"plan of {max(angles_rad, key=abs):g} rad")
        change_rad = max(abs(b - a) for a, b in pairwise(angles_rad))
        if change_rad > plan.spacing * self._bounds.plan_step_rad:
            self.invalid.append(f"plan steps by {change_rad:g} rad in {plan.spacing} samples")

    def _has_refused(self, rejected: int) -> bool:
        """Whether a status reports more frames rejected, or missed, than the one before."""
        before, self._rejected = self._rejected, rejected
        return before is not None and rejected != before

    def _note_report(self, now_ns: int, is_wrong: bool) -> None:
        if is_wrong:
            self.reported_ns.append(now_ns)

    def _note_state(self, now_ns: int, is_abnormal: bool) -> None:
        self._note_report(now_ns, is_abnormal)
        if not self.states or self.states[-1][1] != is_abnormal:
            self.states.append((now_ns, is_abnormal))
