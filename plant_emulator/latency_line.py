"""A latency line: what the network adds to the frames of one direction.

For every frame two uniforms are drawn, in this order, whether they are needed or not:

    1. lost or not   (``plant_emulator.loss``)
    2. latency       (``plant_emulator.latency``)

so that runs with the same seed meet the same network, and a distribution with a heavier tail makes
every frame later. Duplicates draw from a stream of their own. A latency of zero is due at the very
instant the frame came: zero latency adds exactly zero delay.

Order (``Order``) is kept per key; frames of one key are those of one message.
"""

from collections import deque
from collections.abc import Iterator
from heapq import heappop, heappush
from itertools import islice
from typing import Generic, NamedTuple, TypeVar

from ..runtime.node import NEVER_NS, NS_PER_S
from ..runtime.record import new_record
from ..runtime.statistics import DurationStatistics
from .latency import QUANTILES, Distribution, correlated_score, uniform_of_score
from .latency_profile import ProfilePoint, profile_at, read_trace
from .latency_settings import LatencySettings, Order
from .loss import LossParams, bernoulli, gilbert_elliott, loss_step

WAITING_MAX = 100_000
"""Frames one line holds: the longest latency at the highest rate, three times over."""

_UNDRAWN_MAX = 1024
"""Uniforms that decide nothing are drawn so many at a time, in a tenth of the time."""

Item = TypeVar("Item")


class Passage(NamedTuple, Generic[Item]):
    """A frame on its way; sorts by due time, then in the order in which frames came."""

    due_ns: int
    sequence: int
    came_ns: int
    key: int
    item: Item

    @property
    def latency_ns(self) -> int:
        """What it spends in the line [ns]."""
        return self.due_ns - self.came_ns


class LineCounts(NamedTuple):
    """What became of the frames: pushed + duplicated = released + lost + superseded + overflowed
    + those that still wait.
    """

    pushed: int
    duplicated: int
    released: int
    lost: int
    superseded: int  # dropped because a newer one of the same key had left before
    overflowed: int


class LatencyLine(Generic[Item]):
    """Holds the frames of one direction until they are due.

    ``uniforms``            stream of the loss and latency of each frame
    ``duplicate_uniforms``  stream of the duplicates

    ``next_due_ns``         when the next frame is due [ns]; NEVER_NS with none waiting
    ``latest_latency_ns``   latency drawn for the newest frame that was not lost [ns]
    ``latency``             of the frames that have left the line: not of those that were overtaken
    ``injected``            latency drawn for every frame that was not lost, duplicates included
    """

    def __init__(
        self,
        settings: LatencySettings,
        uniforms: Iterator[float],
        duplicate_uniforms: Iterator[float],
    ) -> None:
        self._settings = settings
        self._uniforms = uniforms
        self._duplicate_uniforms = duplicate_uniforms
        self._quantile = settings.quantile
        self._schedule = tuple(
            ProfilePoint(point.time_s, point.mean_s, point.spread_s, point.loss)
            for point in settings.schedule
        )
        self._trace = None if settings.trace_file is None else read_trace(settings.trace_file)
        self._mean_s = settings.mean_s
        self._spread_s = settings.spread_s
        self._loss = self._loss_params(settings.loss)
        self._in_burst = False
        self._score = 0.0
        self._score_ns: int | None = None
        self._newest_wins = settings.order is Order.NEWEST_WINS
        self._in_order = settings.order is Order.IN_ORDER
        self._waiting: list[Passage[Item]] = []
        self.next_due_ns = NEVER_NS
        self._sequence = 0
        self._last_due_ns: dict[int, int] = {}
        self._newest_released: dict[int, int] = {}
        self.latest_latency_ns = 0
        self._constant_ns = self._constant_latency_ns()
        self._undrawn = 0
        """Uniforms of frames so far that decided nothing, and are not drawn yet."""
        self._pushed = self._duplicated = self._released = 0
        self._lost = self._superseded = self._overflowed = 0
        self.latency = DurationStatistics()
        self.injected = DurationStatistics()

    @property
    def counts(self) -> LineCounts:
        """What became of the frames so far."""
        return LineCounts(
            self._pushed,
            self._duplicated,
            self._released,
            self._lost,
            self._superseded,
            self._overflowed,
        )

    def reconfigure(self, model: Distribution, mean_s: float, spread_s: float, loss: float) -> None:
        """Change the network from the next frame on; ends a schedule and a trace."""
        self._draw()
        self._quantile = QUANTILES[model]
        self._schedule = ()
        self._trace = None
        self._mean_s = mean_s
        self._spread_s = spread_s
        self._loss = self._loss_params(loss)
        self._constant_ns = self._constant_latency_ns()

    def push(self, key: int, item: Item, now_ns: int, motion_ns: int) -> None:
        """Take a frame that comes at ``now_ns``, ``motion_ns`` after the start of motion."""
        if self._constant_ns is not None:
            self._pushed += 1
            self._undrawn += 2
            if self._undrawn >= _UNDRAWN_MAX:
                self._draw()
            self.latest_latency_ns = self._constant_ns
            self._wait(key, item, now_ns, self._constant_ns)
            return
        if self._schedule:
            self._follow_schedule(motion_ns)
        loss_u, latency_u = next(self._uniforms), next(self._uniforms)
        self._in_burst, is_lost = loss_step(self._loss, self._in_burst, loss_u)
        if self._settings.correlation_time_s > 0.0:
            latency_u = self._correlated(latency_u, now_ns)
        latency_ns = self._latency_ns(latency_u, motion_ns)
        if is_lost:
            self._lost += 1
        else:
            self.latest_latency_ns = latency_ns
            self._wait(key, item, now_ns, latency_ns)
        if self._settings.duplicates > 0.0:
            self._duplicate(key, item, now_ns, motion_ns, is_lost)
        self._pushed += 1

    def pop_due(self, now_ns: int) -> list[Passage[Item]]:
        """Return the frames due up to ``now_ns``, in the order in which they leave."""
        released: list[Passage[Item]] = []
        waiting, newest = self._waiting, self._newest_released
        while self.next_due_ns <= now_ns:
            passage = heappop(waiting)
            due_ns, sequence, came_ns, key, _ = passage
            self.latency.record(due_ns - came_ns)
            released.append(passage)
            if self._newest_wins:
                newest[key] = sequence
            self.next_due_ns = NEVER_NS
            while waiting:
                due_ns, sequence, _, key, _ = waiting[0]
                if not self._newest_wins or sequence >= newest.get(key, -1):
                    self.next_due_ns = due_ns
                    break
                # Older than what has left: nobody waits for it.
                heappop(waiting)
                self._superseded += 1
        self._released += len(released)
        return released

    def _draw(self) -> None:
        """Draw what frames of a constant latency left, so that the next one meets its own draws."""
        deque(islice(self._uniforms, self._undrawn), maxlen=0)
        self._undrawn = 0

    def _follow_schedule(self, motion_ns: int) -> None:
        shape, time_s = self._settings.schedule_shape, motion_ns / NS_PER_S
        _, self._mean_s, self._spread_s, loss = profile_at(self._schedule, shape, time_s)
        self._loss = self._loss_params(loss)

    def _constant_latency_ns(self) -> int | None:
        """Return the latency of every frame, whatever is drawn [ns]; None where draws decide."""
        is_drawn = (
            self._quantile is not QUANTILES[Distribution.CONSTANT]
            or self._schedule
            or self._trace is not None
            or self._in_burst
            or self._loss != bernoulli(0.0)
            or self._settings.duplicates > 0.0
            or self._settings.correlation_time_s > 0.0
        )
        return None if is_drawn else round(self._mean_s * NS_PER_S)

    def _latency_ns(self, u: float, motion_ns: int) -> int:
        """Return the latency of the frame that is being pushed [ns]."""
        if self._trace is not None:
            return round(self._trace.latency_s(self._pushed, motion_ns / NS_PER_S) * NS_PER_S)
        return round(self._quantile(u, self._mean_s, self._spread_s) * NS_PER_S)

    def _correlated(self, u: float, now_ns: int) -> float:
        """Return the uniform of the AR(1) process, which starts in its stationary state."""
        # Before the first frame lies all the time in the world: its score is drawn freely.
        elapsed_s = float("inf") if self._score_ns is None else (now_ns - self._score_ns) / NS_PER_S
        self._score = correlated_score(self._score, u, elapsed_s, self._settings.correlation_time_s)
        self._score_ns = now_ns
        return uniform_of_score(self._score)

    def _duplicate(self, key: int, item: Item, now_ns: int, motion_ns: int, is_lost: bool) -> None:
        """Perhaps let a frame that is not lost come a second time."""
        chance_u, latency_u = next(self._duplicate_uniforms), next(self._duplicate_uniforms)
        if not is_lost and chance_u < self._settings.duplicates:
            self._duplicated += 1
            self._wait(key, item, now_ns, self._latency_ns(latency_u, motion_ns))

    def _wait(self, key: int, item: Item, now_ns: int, latency_ns: int) -> None:
        """Queue a frame until it is due."""
        self.injected.record(latency_ns)
        if len(self._waiting) >= WAITING_MAX:
            self._overflowed += 1
            return
        due_ns = now_ns + latency_ns
        if self._in_order:
            due_ns = max(due_ns, self._last_due_ns.get(key, due_ns))
            self._last_due_ns[key] = due_ns
        heappush(self._waiting, new_record(Passage, (due_ns, self._sequence, now_ns, key, item)))
        self._sequence += 1
        if due_ns < self.next_due_ns:
            self.next_due_ns = due_ns

    def _loss_params(self, loss: float) -> LossParams:
        table = self._settings
        if table.burst_frames is None:
            return bernoulli(loss)
        return gilbert_elliott(loss, table.burst_frames, table.loss_in_good, table.loss_in_burst)
