"""The state of the bus now and its history over the last SPAN_S, as programs show them live.

Times are those at which a frame has arrived, or the program took it where the port does not know.
Its figures of latency then contain its own waiting: some hundredths of a millisecond.
Of a frame that was read late no time is measured.
"""

import math
from collections import defaultdict, deque
from collections.abc import Mapping
from typing import NamedTuple, TypeVar

import numpy as np

from ...dbc.listening import OUR_MESSAGES, Listening
from ...dbc.messages import Message, SteeringCommand, SteeringStatus
from ...runtime.frame import Frame
from ...runtime.node import NS_PER_MS, NS_PER_S
from .bus_listener import NAMES, BusListener, Taken
from .held_path import PREVIEW_M, CgDeviation
from .latency_and_jitter import RoundTrips

SPAN_S = 15.0
POINTS_MAX = 1 << 14
"""Points of one quantity that are kept: SPAN_S at 1 kHz."""
SPAN_NS = round(SPAN_S * NS_PER_S)


class Spread(NamedTuple):
    """Median, 99th percentile and maximum of the last SPAN_S [s]."""

    p50_s: float
    p99_s: float
    max_s: float


class Recent:
    """Points of the last SPAN_S."""

    def __init__(self) -> None:
        self._points: deque[tuple[int, float]] = deque(maxlen=POINTS_MAX)

    def add(self, time_ns: int, value: float) -> None:
        """Append a value; times must not fall."""
        self._points.append((time_ns, value))
        while time_ns - self._points[0][0] > SPAN_NS:
            self._points.popleft()

    def newest(self, now_ns: int) -> float:
        """Return the newest value; NaN when there is none of the last second."""
        is_young = self._points and now_ns - self._points[-1][0] < _STALE_NS
        return self._points[-1][1] if is_young else math.nan

    def spread(self, now_ns: int) -> Spread | None:
        """Return the spread of the values [s]; None without any."""
        values_s = [value for time_ns, value in self._points if now_ns - time_ns <= SPAN_NS]
        if not values_s:
            return None
        p50_s, p99_s = np.quantile(values_s, (0.5, 0.99))
        return Spread(float(p50_s), float(p99_s), max(values_s))


_STALE_NS = NS_PER_S
_MARK_NS = NS_PER_S // 10
_M = TypeVar("_M", bound=Message)


class MessageView(NamedTuple):
    """One message on the bus, by its name there.

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


class Newest(NamedTuple):
    """The newest message of each type; of a plan, the command that it is."""

    messages: Mapping[type, Message]

    def of(self, kind: type[_M]) -> _M | None:
        """Return that of a type; None without one."""
        message = self.messages.get(kind)
        return message if isinstance(message, kind) else None


class BusWatch:
    """Takes every frame on the bus; its methods tell the state at a time.

    ``round_trips``     from a command to the first status that names it [s]
    ``cg_deviation_m``  newest deviation of the centre of gravity [m]; NaN where it is not known yet
    """

    def __init__(self, start_ns: int, listening: Listening = OUR_MESSAGES) -> None:
        self.start_ns = start_ns
        self.listener = BusListener(listening)
        self._frames = 0
        self._marks: deque[tuple[int, int]] = deque([(start_ns, 0)], maxlen=11)
        self._newest: dict[type[Message], tuple[int, Message]] = {}
        self.round_trips = Recent()
        self._cycles = defaultdict[str, Recent](Recent)
        self._arrived_ns: dict[str, int] = {}
        """When the newest frame came, by the message's name on the bus."""
        self._in_flight = RoundTrips()
        self._timed: set[str] = set()
        """What has a newest message with a time, by name."""
        self._cg = CgDeviation(PREVIEW_M)
        self.cg_deviation_m = math.nan

    def on_frame(self, frame: Frame, now_ns: int, *, has_time: bool = True) -> Taken:
        """Take a frame that arrived at ``now_ns``; returns its messages if they are newer than all.

        ``has_time``  False: it may have arrived much earlier
        """
        self._frames += 1
        if now_ns - self._marks[-1][0] >= _MARK_NS:
            self._marks.append((now_ns, self._frames))
        messages, of_car = self.listener.on_frame(frame, now_ns)
        messages = [one for one in messages if not one.is_late]
        if of_car:
            self._time(of_car, now_ns, has_time)
        for received in messages:
            shown = received.shown
            self._time(NAMES[type(shown)], now_ns, has_time)
            self._newest[type(shown)] = now_ns, shown
            self._follow(shown, now_ns, has_time)
        return Taken(messages, of_car)

    def _time(self, name: str, now_ns: int, has_time: bool) -> None:
        before_ns = self._arrived_ns.get(name)
        if before_ns is not None and has_time and name in self._timed:
            self._cycles[name].add(now_ns, (now_ns - before_ns) / NS_PER_S)
        (self._timed.add if has_time else self._timed.discard)(name)
        self._arrived_ns[name] = now_ns

    def newest(self, now_ns: int | None = None) -> Newest:
        """Return the newest messages; at a time ``now_ns``, those of the last second."""
        return Newest(
            {
                kind: message
                for kind, (time_ns, message) in self._newest.items()
                if now_ns is None or now_ns - time_ns < _STALE_NS
            }
        )

    def forget(self, kind: type[Message]) -> None:
        """Forget the newest message of a type."""
        self._newest.pop(kind, None)

    def _follow(self, message: Message, now_ns: int, has_time: bool) -> None:
        cg_m = self._cg.on_message(message, (now_ns - self.start_ns) / NS_PER_S)
        if not math.isnan(cg_m):
            self.cg_deviation_m = cg_m
        if isinstance(message, SteeringCommand):
            self._in_flight.on_command(message, now_ns if has_time else None)
        elif isinstance(message, SteeringStatus):
            round_trip_ns = self._in_flight.on_status(message, now_ns)
            if has_time and round_trip_ns is not None:
                self.round_trips.add(now_ns, round_trip_ns / NS_PER_S)

    def messages(self, now_ns: int) -> tuple[MessageView, ...]:
        """Return every message on the bus as it stands at ``now_ns``."""
        listed = self.listener.listening.listed
        return tuple(self._message(name, it.cycle_ms, now_ns) for name, it in listed.items())

    def _message(self, name: str, period_ms: float, now_ns: int) -> MessageView:
        counts = self.listener.counts(name)
        newest_ns = self._arrived_ns.get(name)
        period_s = period_ms * NS_PER_MS / NS_PER_S if period_ms else None
        cycle = None if period_s is None else self._cycles[name].spread(now_ns)
        is_old = newest_ns is not None and now_ns - newest_ns >= _STALE_NS
        frames = counts.accepted, counts.missing, counts.late, sum(counts.refused.values())
        return MessageView(name, period_s, cycle, *frames, is_old and period_s is not None)

    def frames_per_s(self, now_ns: int) -> float:
        """Return the frames per second over about the last second."""
        since_ns, frames = self._marks[0]
        if now_ns - self._marks[-1][0] >= _STALE_NS or now_ns <= since_ns:
            return 0.0
        return (self._frames - frames) * NS_PER_S / (now_ns - since_ns)
