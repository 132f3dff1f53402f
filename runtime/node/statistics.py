"""Statistics of durations (lateness, latency) in bounded memory, however long the run.

Durations are counted in bins that widen with the duration, as in an HDR histogram: below 256 ns
every nanosecond has its bin, above that every power of two is split into 128 bins. A quantile is
the middle of its bin, so it is within 0.4 % of a recorded duration, and never outside the least and
the largest. Number, mean, least and largest are exact. The figures do not depend on the order of
the durations.
"""

from collections import Counter, defaultdict

from .node import NS_PER_S

_BIN_BITS = 8
"""Leading bits of a duration, which select its bin."""
_LEADING_MASK = (1 << _BIN_BITS) - 1
_BLOCK = 256
"""Durations that are counted together; this takes tens of microseconds if all differ."""


class DurationStatistics:
    """Takes durations one at a time."""

    def __init__(self) -> None:
        # At most 57 powers of two with 128 bins each for durations below 2**63 ns.
        self._bins: defaultdict[int, int] = defaultdict(int)
        self._total_ns = 0
        self._min_ns = self._max_ns = 0
        self._waiting: list[int] = []
        """Durations not in the bins yet; they are counted in blocks, equal ones together."""

    def record(self, duration_ns: int) -> None:
        """Add one duration [ns]. Raises ValueError for a negative one: a clock ran backwards."""
        if duration_ns < 0:
            raise ValueError(f"a duration cannot be negative: {duration_ns} ns")
        waiting = self._waiting
        waiting.append(duration_ns)
        if len(waiting) >= _BLOCK:
            self._count_waiting()

    def record_many(self, duration_ns: int, count: int) -> None:
        """Add one duration, 0 or more [ns], ``count`` times."""
        if count == 0:
            return
        self._min_ns = min(self._min_ns, duration_ns) if self._bins else duration_ns
        self._max_ns = max(self._max_ns, duration_ns)
        self._total_ns += count * duration_ns
        shift = max(duration_ns.bit_length() - _BIN_BITS, 0)
        # The leading bits are below 2**_BIN_BITS, so bins sort like their durations.
        self._bins[shift << _BIN_BITS | duration_ns >> shift] += count

    def _count_waiting(self) -> None:
        for duration_ns, count in Counter(self._waiting).items():
            self.record_many(duration_ns, count)
        self._waiting.clear()

    def quantile_ns(self, fraction: float) -> int:
        """The shortest duration that ``fraction`` (0 to 1) of all do not exceed [ns].

        0 when nothing was recorded. Raises ValueError for a fraction outside 0 to 1.
        """
        if not 0 <= fraction <= 1:
            raise ValueError(f"a quantile is asked for with 0 to 1, not {fraction}")
        self._count_waiting()
        reached = 0
        wanted = fraction * sum(self._bins.values())
        for number, count in sorted(self._bins.items()):
            reached += count
            if reached >= wanted:
                shift, leading = number >> _BIN_BITS, number & _LEADING_MASK
                middle_ns = (leading << shift) + ((1 << shift) >> 1)
                return max(min(middle_ns, self._max_ns), self._min_ns)
        return 0

    def report(self) -> dict[str, float]:
        """Return number, mean, median, 99th percentile and maximum; zeros without durations."""
        self._count_waiting()
        samples = sum(self._bins.values())
        return {
            "samples": samples,
            "mean_s": self._total_ns / samples / NS_PER_S if samples else 0.0,
            "p50_s": self.quantile_ns(0.5) / NS_PER_S,
            "p99_s": self.quantile_ns(0.99) / NS_PER_S,
            "max_s": self._max_ns / NS_PER_S,
        }
