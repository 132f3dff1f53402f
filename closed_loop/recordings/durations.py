"""Statistics and thinned time histories in bounded memory, however long the log."""

import math
from typing import Any

import numpy as np

from ...runtime.array_types import FloatArray
from ...runtime.node import NS_PER_S
from ...runtime.node.statistics import DurationStatistics, durations_report

POINTS_MAX = 20_000
"""How many points of a time history are kept, at least half of them after the first thinning."""


class Durations:
    """Collects durations one at a time; their spread too.

    A negative duration, possible only where a clock was set back, counts as zero.
    """

    def __init__(self) -> None:
        self._statistics = DurationStatistics()
        self._sum_s2 = 0.0
        self._min_ns: int | None = None

    def record(self, duration_ns: int) -> None:
        """Add one duration [ns]."""
        duration_ns = max(duration_ns, 0)
        self._statistics.record(duration_ns)
        self._sum_s2 += (duration_ns / NS_PER_S) ** 2
        if self._min_ns is None or duration_ns < self._min_ns:
            self._min_ns = duration_ns

    def quantiles_s(self, fractions: FloatArray) -> FloatArray:
        """Return the quantiles at ``fractions`` (0 to 1), shape (n,), in seconds."""
        return np.array([self._statistics.quantile_ns(f) / NS_PER_S for f in fractions])

    def report(self) -> dict[str, Any]:
        """Return the figures, times in seconds; None for those that need at least one duration.

        ``jitter_s``  standard deviation
        """
        summary = self._statistics.summary()
        if not summary.samples:
            keys = ("min_s", "mean_s", "p50_s", "p99_s", "max_s", "jitter_s")
            return {"samples": 0, **dict.fromkeys(keys)}
        figures = durations_report(summary)
        variance_s2 = self._sum_s2 / summary.samples - figures["mean_s"] ** 2
        least = {"samples": summary.samples, "min_s": (self._min_ns or 0) / NS_PER_S}
        return {**least, **figures, "jitter_s": math.sqrt(max(variance_s2, 0.0))}


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
