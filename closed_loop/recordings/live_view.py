"""From frames to a view: the state of the bus now, and its history over the last SPAN_S.

Times are those at which the program took a frame. So its figures of latency and lateness contain
its own waiting; on a machine that is not overloaded that is some hundredths of a millisecond.
"""

import math
from collections import deque
from collections.abc import Mapping
from typing import NamedTuple, TypeVar

from ...dbc.messages import (
    CYCLE_TIMES_MS,
    MESSAGE_TYPES,
    ControllerSafety,
    ControllerStatus,
    DelayStatus,
    LateralError,
    Message,
    PlantStatus,
    SteeringCommand,
    SteeringStatus,
    SteeringStatusCode,
    VehicleState,
)
from ...runtime.frame import Frame
from ...runtime.node import NS_PER_MS, NS_PER_S
from .bus_listener import NAMES, BusListener, ReceivedMessage
from .held_path import PREVIEW_M, CgDeviation
from .recent import CommandLateness, Recent, Spread, Strip, spread_of, strip_of

STRIPS = ("lateral_error_m", "steer_rad", "downlink_s", "uplink_s", "round_trip_s", "lateness_s")
_STALE_NS = NS_PER_S
_MARK_NS = NS_PER_S // 10
_IN_FLIGHT_MAX = 4096
_M = TypeVar("_M", bound=Message)


class MessageView(NamedTuple):
    """One message on the bus.

    ``period_s``    the DBC's; None for one that is sent when needed
    ``cycle``       intervals between its frames; None with fewer than two of them
    ``is_stale``    whether it has not been received for a second or more
    """

    name: str
    period_s: float | None
    cycle: Spread | None
    accepted: int
    missing: int
    late: int
    refused: int
    is_stale: bool


class View(NamedTuple):
    """Everything the monitor shows; None for what was not received yet.

    ``cg_deviation_m``  of the centre of gravity; NaN where it is not known yet
    """

    elapsed_s: float
    frames: int
    frames_per_s: float
    error: LateralError | None
    cg_deviation_m: float
    command: SteeringCommand | None
    steering: SteeringStatus | None
    vehicle: VehicleState | None
    controller: ControllerStatus | None
    safety: ControllerSafety | None
    delay: DelayStatus | None
    plant: PlantStatus | None
    strips: Mapping[str, Strip]
    round_trip: Spread | None
    lateness: Spread | None
    messages: tuple[MessageView, ...]
    refused: Mapping[str, int]
    foreign_frames: int
    foreign_ids: tuple[int, ...]
    error_frames: int

    def is_stale(self, name: str) -> bool:
        """Whether the message called ``name`` in the DBC was received, but not lately."""
        return any(row.name == name and row.is_stale for row in self.messages)


class BusWatch:
    """Takes every frame on the bus; ``view`` returns the state to be shown.

    ``cg_deviation_m``  newest deviation of the centre of gravity [m]; NaN where it is not known yet
    """

    def __init__(self, start_ns: int) -> None:
        self._start_ns = start_ns
        self._listener = BusListener()
        self._frames = 0
        self._marks: deque[tuple[int, int]] = deque([(start_ns, 0)], maxlen=11)
        self._newest: dict[str, tuple[Message, int]] = {}
        """Message and arrival, by the name of what is shown: a plan is a command."""
        self._recent = {name: Recent() for name in STRIPS if name != "lateness_s"}
        self._cycles = {name: Recent() for name in MESSAGE_TYPES}
        self._lateness = CommandLateness()
        self._sent_ns: dict[int, int] = {}
        self._cg = CgDeviation(PREVIEW_M)
        self.cg_deviation_m = math.nan

    @property
    def round_trip_s(self) -> float:
        """The newest round trip [s]; NaN before the first."""
        return self._recent["round_trip_s"].newest

    @property
    def lateness_s(self) -> float:
        """How late the newest command was [s]; NaN before three of them."""
        return self._lateness.newest_s()

    @property
    def refused(self) -> Mapping[str, int]:
        """Rejected frames, by cause."""
        return self._listener.refused

    def on_frame(self, frame: Frame, now_ns: int) -> ReceivedMessage | None:
        """Take a frame that arrived at ``now_ns``; returns its message if it is newer than all."""
        self._frames += 1
        if now_ns - self._marks[-1][0] >= _MARK_NS:
            self._marks.append((now_ns, self._frames))
        received = self._listener.take(frame)
        if received is None or received.is_late:
            return None
        shown = received.shown
        name = NAMES[type(shown)]
        before = self._newest.get(name)
        if before is not None:
            self._cycles[name].add(now_ns, (now_ns - before[1]) / NS_PER_S)
        self._newest[name] = (shown, now_ns)
        self._follow(shown, now_ns)
        return received

    def view(self, now_ns: int) -> View:
        """Return the state to be shown at ``now_ns``."""
        late_ages_ns, lateness_s = self._lateness.arrays(now_ns)
        strips = {name: recent.strip(now_ns) for name, recent in self._recent.items()}
        strips["lateness_s"] = strip_of(late_ages_ns, lateness_s)
        newest: dict[type, Message] = {
            type(message): message for message, _ in self._newest.values()
        }

        def shown(kind: type[_M]) -> _M | None:
            message = newest.get(kind)
            return message if isinstance(message, kind) else None

        return View(
            elapsed_s=(now_ns - self._start_ns) / NS_PER_S,
            frames=self._frames,
            frames_per_s=self.frames_per_s(now_ns),
            error=shown(LateralError),
            cg_deviation_m=self.cg_deviation_m,
            command=shown(SteeringCommand),
            steering=shown(SteeringStatus),
            vehicle=shown(VehicleState),
            controller=shown(ControllerStatus),
            safety=shown(ControllerSafety),
            delay=shown(DelayStatus),
            plant=shown(PlantStatus),
            strips=strips,
            round_trip=self._recent["round_trip_s"].spread(now_ns),
            lateness=spread_of(lateness_s),
            messages=self.messages(now_ns),
            refused=self.refused,
            foreign_frames=self._listener.foreign_frames,
            foreign_ids=tuple(self._listener.foreign),
            error_frames=self._listener.error_frames,
        )

    def _follow(self, message: Message, now_ns: int) -> None:
        cg_m = self._cg.take(message, (now_ns - self._start_ns) / NS_PER_S)
        if not math.isnan(cg_m):
            self.cg_deviation_m = cg_m
        if isinstance(message, LateralError):
            self._recent["lateral_error_m"].add(now_ns, message.lateral_error_m)
        elif isinstance(message, SteeringCommand):
            self._recent["steer_rad"].add(now_ns, message.steer_rad)
            if len(self._sent_ns) >= _IN_FLIGHT_MAX:
                del self._sent_ns[next(iter(self._sent_ns))]  # the oldest: a dict keeps its order
            self._sent_ns[message.command_counter] = now_ns
            self._lateness.take(message.command_counter, now_ns)
        elif isinstance(message, SteeringStatus):
            sent_ns = self._sent_ns.pop(message.applied_counter, None)
            if sent_ns is not None and message.status is not SteeringStatusCode.NO_COMMAND:
                self._recent["round_trip_s"].add(now_ns, (now_ns - sent_ns) / NS_PER_S)
        elif isinstance(message, PlantStatus):
            self._recent["downlink_s"].add(now_ns, message.downlink_latency_s)
            self._recent["uplink_s"].add(now_ns, message.uplink_latency_s)

    def messages(self, now_ns: int) -> tuple[MessageView, ...]:
        """Return every message of the DBC as seen at ``now_ns``."""
        return tuple(self._message(name, now_ns) for name in MESSAGE_TYPES)

    def _message(self, name: str, now_ns: int) -> MessageView:
        counts = self._listener.counts(name)
        period_ms = CYCLE_TIMES_MS[MESSAGE_TYPES[name]]
        newest = self._newest.get(name)
        period_s = period_ms * NS_PER_MS / NS_PER_S if period_ms else None
        cycle = None if period_s is None else self._cycles[name].spread(now_ns)
        is_old = newest is not None and now_ns - newest[1] >= _STALE_NS
        frames = counts.accepted, counts.missing, counts.late, sum(counts.refused.values())
        return MessageView(name, period_s, cycle, *frames, is_old and period_s is not None)

    def frames_per_s(self, now_ns: int) -> float:
        """Return the frames a second of the last second or so."""
        since_ns, frames = self._marks[0]
        if now_ns - self._marks[-1][0] >= _STALE_NS or now_ns <= since_ns:
            return 0.0
        return (self._frames - frames) * NS_PER_S / (now_ns - since_ns)
