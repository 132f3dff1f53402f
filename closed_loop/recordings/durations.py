"""Durations and time histories of a log, and how well a log of that length knows their figures.

The interval of a figure holds the value of the network, not only of this log, in 95 of 100 logs. It
counts n/τ of n durations, where τ is how many follow one another alike: the larger one of what an
AR(1) process of the same first correlation gives, (1 + ρ)/(1 - ρ), and what the means of 16 to 31
parts of the log show.

    mean      m ± t s/√n                                          Student's t
    jitter    s ± t s √((κ - 1)/n)/2                              κ the kurtosis
    quantile  between the quantiles that Clopper and Pearson give for its share of n
"""

import math
from statistics import NormalDist
from typing import Any

import numpy as np

from ...runtime.array_types import FloatArray
from ...runtime.node import NS_PER_S
from ...runtime.node.statistics import DurationStatistics

CONFIDENCE = 0.95
_Z = NormalDist().inv_cdf(0.5 + 0.5 * CONFIDENCE)
_FEWEST = 5.0
"""Independent durations without which nothing is said."""
_PARTS = 32
_BIN_SHARE = 0.004
"""Width of the bins in which durations are counted."""
Interval = list[float | None]
"""Lower and upper end; None where the log does not know it."""


class Durations:
    """Collects durations one at a time; their spread and intervals too.

    ``resolution_s``  of the level from which they are counted
    ``level_error_s`` how far that level may be off, of CONFIDENCE

    A negative duration, possible only where a clock was set back, counts as zero.
    """

    def __init__(self, resolution_s: float = 0.0) -> None:
        self.resolution_s, self.level_error_s = resolution_s, 0.0
        self._statistics = DurationStatistics()
        self.count = 0
        self._min_ns: int | None = None
        self._first_s = self._before_s = 0.0
        self._sums = [0.0] * 5
        """Of the first four powers of the durations less the first, and of neighbours' products."""
        self._parts: list[float] = []
        self._part_size = 1

    def record(self, duration_ns: int) -> None:
        """Add one duration [ns]."""
        duration_ns = max(duration_ns, 0)
        self._statistics.record(duration_ns)
        self.count += 1
        if self._min_ns is None:
            self._min_ns, self._first_s = duration_ns, duration_ns / NS_PER_S
        elif duration_ns < self._min_ns:
            self._min_ns = duration_ns
        x = duration_ns / NS_PER_S - self._first_s
        square, sums = x * x, self._sums
        sums[0] += x
        sums[1] += square
        sums[2] += square * x
        sums[3] += square * square
        sums[4] += x * self._before_s
        self._before_s = x
        self._add_to_part(x)

    def _add_to_part(self, x: float) -> None:
        if (self.count - 1) % self._part_size == 0:
            if len(self._parts) == _PARTS:
                pairs = zip(self._parts[::2], self._parts[1::2], strict=True)
                self._parts = [one + other for one, other in pairs]
                self._part_size *= 2
            self._parts.append(0.0)
        self._parts[-1] += x

    def quantiles_s(self, fractions: FloatArray) -> FloatArray:
        """Return the quantiles at ``fractions`` (0 to 1), shape (n,), in seconds."""
        return np.array([self._statistics.quantile_ns(f) / NS_PER_S for f in fractions])

    def report(self) -> dict[str, Any]:
        """Return the figures, times in seconds; None for those that need at least one duration.

        ``jitter_s``  standard deviation
        ``interval``  of mean, quantiles and jitter, as in the head of this module
        """
        figures = self._statistics.report()
        n = figures["samples"]
        if not n:
            keys = ("min_s", "mean_s", "p50_s", "p99_s", "max_s", "jitter_s", "interval")
            return {"samples": 0, **dict.fromkeys(keys)}
        mean, two, three, four = (one / n for one in self._sums[:4])
        variance = max(two - mean * mean, 0.0)
        jitter_s = math.sqrt(variance)
        fourth = four - 4.0 * mean * three + 6.0 * mean * mean * two - 3.0 * mean**4
        least = {"samples": n, "min_s": (self._min_ns or 0) / NS_PER_S}
        independent, interval = self.independent(), None
        if independent >= _FEWEST:
            interval = self._intervals(figures["mean_s"], jitter_s, fourth, independent)
        return {**least, **figures, "jitter_s": jitter_s, "interval": interval}

    def independent(self) -> float:
        """Return how many independent durations tell as much as those that were recorded."""
        n = self.count
        if not n:
            return 0.0
        mean = self._sums[0] / n
        variance = self._sums[1] / n - mean * mean
        if variance <= 0.0:
            return n
        kept = (self._sums[4] / n - mean * mean) / variance
        by_neighbours = (1.0 + kept) / (1.0 - kept) if kept < 1.0 else math.inf
        whole = self._parts[: n // self._part_size]
        by_parts = 1.0
        if len(whole) >= _PARTS // 2:
            of_means = float(np.var(np.array(whole) / self._part_size, ddof=1))
            by_parts = of_means * self._part_size / variance
        return n / max(by_neighbours, by_parts, 1.0)

    def _intervals(
        self, mean_s: float, jitter_s: float, fourth: float, n: float
    ) -> dict[str, Interval]:
        student = _Z + (_Z**3 + _Z) / (4.0 * (n - 1.0))
        kurtosis = fourth / jitter_s**4 if jitter_s else 1.0
        mean_half_s = self._with_level(student * jitter_s / math.sqrt(n))
        jitter_half_s = 0.5 * student * jitter_s * math.sqrt(max(kurtosis - 1.0, 0.0) / n)
        return {
            "mean_s": [max(mean_s - mean_half_s, 0.0), mean_s + mean_half_s],
            "p50_s": self._of_quantile(0.5, n),
            "p99_s": self._of_quantile(0.99, n),
            "jitter_s": [max(jitter_s - jitter_half_s, 0.0), jitter_s + jitter_half_s],
        }

    def _of_quantile(self, share: float, n: float) -> Interval:
        from scipy.special import betaincinv  # only a report needs it

        below, above = n * share, n * (1.0 - share)
        low = float(betaincinv(below, above + 1.0, 0.5 - 0.5 * CONFIDENCE))
        high = float(betaincinv(below + 1.0, above, 0.5 + 0.5 * CONFIDENCE))
        low_s, high_s = self.quantiles_s(np.array([low, high]))
        (found_s,) = self.quantiles_s(np.array([share]))
        low_s = found_s - self._with_level(found_s - low_s * (1.0 - _BIN_SHARE))
        high_s = found_s + self._with_level(high_s * (1.0 + _BIN_SHARE) - found_s)
        # Beyond the largest of so few, nothing is known.
        return [max(low_s, 0.0), high_s if high * n <= n - 0.5 else None]

    def _with_level(self, half_s: float) -> float:
        """Return half the width of an interval, with what is not known of the level."""
        return math.hypot(half_s, self.level_error_s) + self.resolution_s


POINTS_MAX = 20_000
"""How many points of a time history are kept, at least half of them after the first thinning."""


class History:
    """A time history for a picture, and exact figures of all its values.

    When it is full, every four consecutive points are reduced to their lowest and their highest,
    so no peak is lost from the picture.
    """

    def __init__(self, points_max: int = POINTS_MAX) -> None:
        self._points_max = points_max
        self._time_s: list[float] = []
        self._values: list[float] = []
        self._samples = 0
        self._sum = 0.0
        self._sum_of_squares = 0.0
        self._peak = 0.0
        self._peak_at_s: float | None = None

    def add(self, time_s: float, value: float) -> None:
        """Append one value; ``time_s`` may be NaN where a log has no times."""
        self._samples += 1
        self._sum += value
        self._sum_of_squares += value * value
        if self._peak_at_s is None or abs(value) > abs(self._peak):
            self._peak, self._peak_at_s = value, time_s
        self._time_s.append(time_s)
        self._values.append(value)
        if len(self._values) >= self._points_max:
            self._thin()

    def points(self) -> tuple[FloatArray, FloatArray]:
        """Return times [s] and values that are kept, each of shape (n,)."""
        return np.array(self._time_s), np.array(self._values)

    @property
    def is_whole(self) -> bool:
        """Whether all points are kept."""
        return len(self._values) == self._samples

    def report(self) -> dict[str, Any]:
        """Return mean, root mean square and peak, with its sign and time."""
        if not self._samples:
            return {"samples": 0, "mean": None, "rms": None, "peak": None, "peak_at_s": None}
        return {
            "samples": self._samples,
            "mean": self._sum / self._samples,
            "rms": math.sqrt(self._sum_of_squares / self._samples),
            "peak": self._peak,
            "peak_at_s": self._peak_at_s,
        }

    def _thin(self) -> None:
        count = len(self._values) // 4 * 4
        time_s, values = self.points()
        groups = values[:count].reshape(-1, 4)
        start = np.arange(0, count, 4)
        ends = np.stack((start + groups.argmin(axis=1), start + groups.argmax(axis=1)), axis=1)
        kept = np.concatenate((np.sort(ends, axis=1).ravel(), np.arange(count, len(values))))
        self._time_s = time_s[kept].tolist()
        self._values = values[kept].tolist()
