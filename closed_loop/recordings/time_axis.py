"""The time axis of a log, whose recorder's clock may have been set on the way."""

from datetime import UTC, datetime

from ...runtime.node import NS_PER_S

CLOCK_STARTED_NS = 631_152_000 * NS_PER_S
"""1990: greater times are dates; smaller ones count from some start."""
CLOCK_SET_NS = 24 * 3600 * NS_PER_S
"""A longer time without any frame is a clock that was set, from 1970 to the date for instance."""
CLOCK_SET_BACK_NS = NS_PER_S // 10
"""Frames that lie further back than a recorder swaps them, two in a row, are a clock set back."""


class TimeAxis:
    """The times of a log since its first frame, without what a clock that was set has leapt.

    ``clock_set``  how often it was set forward, by more than a day
    ``set_back``   how often it was set back
    ``backwards``  other frames so far whose time is before that of an earlier one
    ``at_rest``    frames at the newest time so far, which are few if the clock is fine enough
    """

    def __init__(self) -> None:
        self._start_ns: int | None = None
        self._end_ns = 0
        self._aside_ns: int | None = None  # of the frame before, if it lies far back
        self.backwards = self.clock_set = self.set_back = self.at_rest = 0

    def since_start_ns(self, time_ns: int | None) -> int | None:
        """Return the time of the next frame since the start [ns]; None for one without time."""
        if time_ns is None:
            return None
        if self._start_ns is None:
            self._start_ns = self._end_ns = time_ns
        aside_ns, self._aside_ns = self._aside_ns, None
        if time_ns < self._end_ns - CLOCK_SET_BACK_NS:
            if aside_ns is None or not 0 <= time_ns - aside_ns <= CLOCK_SET_BACK_NS:
                self.backwards += 1
                self._aside_ns = time_ns
                return self._end_ns - self._start_ns
            self.backwards -= 1
            self.set_back += 1
            self._start_ns += aside_ns - self._end_ns
            self._end_ns = time_ns
        self.at_rest += time_ns == self._end_ns
        if time_ns < self._end_ns:
            self.backwards += 1
        if time_ns - self._end_ns > CLOCK_SET_NS:
            self._start_ns += time_ns - self._end_ns
            self.clock_set += 1
        self._end_ns = max(self._end_ns, time_ns)
        return time_ns - self._start_ns

    @property
    def duration_ns(self) -> int | None:
        """From the first to the last frame [ns]; None in a log without times."""
        return None if self._start_ns is None else self._end_ns - self._start_ns

    @property
    def start_date(self) -> str | None:
        """The date of the start; None where times are not dates."""
        if self._start_ns is None or self._start_ns < CLOCK_STARTED_NS:
            return None
        start = datetime.fromtimestamp(self._start_ns / NS_PER_S, UTC)
        return start.isoformat(timespec="microseconds")
