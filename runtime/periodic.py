"""Periodic deadlines that never drift: ``start_ns + index * period_ns``, in integers.

An overrun keeps phase: the periods that passed meanwhile are counted and never made up.
"""


class PeriodicTimer:
    """The deadlines of one periodic activity.

    ``start_ns``   first deadline [ns]
    ``period_ns``  distance of two deadlines [ns], positive; ValueError otherwise
    """

    def __init__(self, start_ns: int, period_ns: int) -> None:
        if period_ns <= 0:
            raise ValueError(f"period_ns must be positive, not {period_ns}")
        self._start_ns = start_ns
        self._period_ns = period_ns
        self._index = 0
        self._deadline_ns = start_ns
        self._skipped = 0

    @property
    def deadline_ns(self) -> int:
        """When the next period is due [ns]."""
        return self._deadline_ns

    @property
    def index(self) -> int:
        """Number of the period that is due next; the first is 0."""
        return self._index

    @property
    def skipped(self) -> int:
        """Periods that passed without being served."""
        return self._skipped

    def advance(self, now_ns: int) -> int:
        """Serve the period that is due and move to the first deadline after ``now_ns``.

        Returns the number of the period served. Raises ValueError before the deadline: serving
        early would put two steps into one period.
        """
        if now_ns < self._deadline_ns:
            raise ValueError(f"{self._deadline_ns - now_ns} ns too early for the next period")
        served = self._index
        self._index = (now_ns - self._start_ns) // self._period_ns + 1
        self._deadline_ns = self._start_ns + self._index * self._period_ns
        self._skipped += self._index - served - 1
        return served
