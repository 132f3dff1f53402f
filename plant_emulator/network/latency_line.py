"""A latency line: delays and loses the frames of one direction as a network does.

How long a frame takes, and whether it is lost, is drawn (``plant_emulator.network.latency_draw``).
A latency of zero is due at the very instant the frame came: zero latency adds exactly zero delay.

Order (``Order``) is kept per key; frames of one key are those of one message. Where the latency is
constant, nothing can overtake, and frames that come together stay together.
"""

from collections import defaultdict, deque
from collections.abc import Callable, Iterator, Sequence
from heapq import heappop, heappush
from typing import Any, Generic, NamedTuple, TypeVar

from ...runtime.node import NEVER_NS
from ...runtime.node.statistics import DurationStatistics
from .latency_distributions import Distribution
from .latency_draw import LatencyDraw
from .settings import LatencySettings, Order

WAITING_MAX = 100_000
"""Frames that a line holds: three times those of the longest latency at the highest rate."""

Item = TypeVar("Item", bound=tuple[Any, ...])
"""A frame, or what takes its place: a tuple that begins with its key."""


Passage = tuple[int, int, Sequence[Item]]
"""When frames leave the line together, when they came [ns], and the frames."""
_FRAMES_MAX = 8
"""More frames than ever come together."""


class LineCounts(NamedTuple):
    """Counts of frames: pushed = released + lost + superseded + overflowed + those waiting."""

    pushed: int
    released: int
    lost: int
    superseded: int  # dropped because a newer one of the same key had left before
    overflowed: int


class LatencyLine(Generic[Item]):
    """Holds the frames of one direction until they are due.

    ``stream``  as of ``LatencyDraw``

    ``next_due_ns``  when the next frame is due [ns]; NEVER_NS if none waits
    ``trace_times_s``  as of ``LatencyDraw``
    ``lost``  frames so far
    ``latest_latency_ns``  drawn for the newest frame that was not lost [ns]
    """

    def __init__(self, settings: LatencySettings, stream: Callable[[int], Iterator[float]]) -> None:
        self._draw = LatencyDraw(settings, stream)
        self.trace_times_s = self._draw.trace_times_s
        self._newest_wins = settings.order is Order.NEWEST_WINS
        self._in_order = settings.order is Order.IN_ORDER
        self._in_turn: deque[Passage[Item]] = deque()
        """Waiting frames, all of one constant latency."""
        self._waiting: list[tuple[int, int, int, Item]] = []
        """Due time, number, arrival and item of each other frame; a heap."""
        self.next_due_ns = NEVER_NS
        self._sequence = 0
        self._last_due_ns: dict[int, int] = {}
        self._newest_released: defaultdict[int, int] = defaultdict(int)
        self.latest_latency_ns = 0
        self._samples = 0
        """Calls of ``push``, while latencies are drawn: a trace may have one row for each."""
        self._pushed = self._released = 0
        self.lost = self._superseded = self._overflowed = 0
        self._latency, self._injected = DurationStatistics(), DurationStatistics()
        self._came_in_turn = self._left_in_turn = 0
        """Frames of constant latency that are not in the statistics yet."""

    @property
    def counts(self) -> LineCounts:
        """Counts of the frames so far."""
        return LineCounts(
            self._pushed + self._came_in_turn,
            self._released + self._left_in_turn,
            self.lost,
            self._superseded,
            self._overflowed,
        )

    @property
    def latency(self) -> DurationStatistics:
        """Latencies of the frames that have left the line, without those that were overtaken."""
        self._settle()
        return self._latency

    @property
    def injected(self) -> DurationStatistics:
        """Latencies drawn for every frame that was not lost."""
        self._settle()
        return self._injected

    def reconfigure(self, model: Distribution, mean_s: float, spread_s: float, loss: float) -> None:
        """Change the network from the next frame on; this ends a schedule or a trace."""
        self._settle()
        self._separate()
        self._draw.reconfigure(model, mean_s, spread_s, loss, self._pushed)

    def push(self, frames: Sequence[Item], now_ns: int, motion_ns: int) -> None:
        """Put frames into the line at ``now_ns``, ``motion_ns`` after the start of motion."""
        waiting, constant_ns = self._waiting, self._draw.constant_ns
        if constant_ns is not None:
            self.latest_latency_ns = constant_ns
            in_turn = self._in_turn
            if not waiting and _FRAMES_MAX * len(in_turn) < WAITING_MAX:
                self._came_in_turn += len(frames)
                in_turn.append((now_ns + constant_ns, now_ns, frames))
                self.next_due_ns = in_turn[0][0]
                return
            self._separate()
        in_order, sequence = self._in_order, self._sequence
        for item in frames:
            latency_ns = constant_ns
            if latency_ns is None:
                latency_ns = self._draw.latency_ns(self._samples, now_ns, motion_ns)
            self._pushed += 1
            if latency_ns is None:
                self.lost += 1
                continue
            self.latest_latency_ns = latency_ns
            self._injected.record(latency_ns)
            if len(waiting) >= WAITING_MAX:
                self._overflowed += 1
                continue
            due_ns = now_ns + latency_ns
            if in_order:
                key = item[0]
                due_ns = max(due_ns, self._last_due_ns.get(key, due_ns))
                self._last_due_ns[key] = due_ns
            sequence += 1
            heappush(waiting, (due_ns, sequence, now_ns, item))
        self._sequence = sequence
        self._samples += 1
        if waiting:
            self.next_due_ns = waiting[0][0]

    def pop_due(self, now_ns: int) -> list[Passage[Item]]:
        """Return the frames due up to ``now_ns``, in order."""
        released: list[Passage[Item]] = []
        in_turn, self.next_due_ns = self._in_turn, NEVER_NS
        while in_turn:
            due_ns, _, frames = passage = in_turn[0]
            if due_ns > now_ns:
                self.next_due_ns = due_ns
                return released
            self._left_in_turn += len(frames)
            released.append(passage)
            in_turn.popleft()
        waiting = self._waiting
        if not waiting:
            return released
        newest, newest_wins = self._newest_released, self._newest_wins
        while waiting:
            due_ns, sequence, came_ns, item = waiting[0]
            if sequence < newest[item[0]]:  # a newer one of the same key has left
                self._superseded += 1
            elif due_ns > now_ns:
                self.next_due_ns = due_ns
                break
            else:
                self._latency.record(due_ns - came_ns)
                self._released += 1
                released.append((due_ns, came_ns, (item,)))
                if newest_wins:
                    newest[item[0]] = sequence
            heappop(waiting)
        return released

    def _separate(self) -> None:
        """Move the waiting frames to the heap, where others can overtake them."""
        for due_ns, came_ns, frames in self._in_turn:
            for item in frames:
                self._sequence += 1
                self._last_due_ns[item[0]] = due_ns
                self._waiting.append((due_ns, self._sequence, came_ns, item))
        self._in_turn.clear()

    def _settle(self) -> None:
        """Take the frames of constant latency into the statistics."""
        if (constant_ns := self._draw.constant_ns) is not None:
            self._latency.record_many(constant_ns, self._left_in_turn)
            self._injected.record_many(constant_ns, self._came_in_turn)
        self._pushed += self._came_in_turn
        self._released += self._left_in_turn
        self._came_in_turn = self._left_in_turn = 0
