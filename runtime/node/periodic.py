"""Periodic deadlines that never drift: ``start_ns + index * period_ns``, in integers.

An overrun keeps phase: the periods that passed meanwhile are counted and never made up.
"""


class PeriodicTimer:
    """The deadlines of one periodic activity; ValueError for a period that is not positive.

    ``index``        number of the period that is due next; the first is 0
    ``skipped``      periods that passed without being served
    """

    def __init__(self, start_ns: int, period_ns: int) -> None:
        if period_ns <= 0:
            raise ValueError(f"period_ns must be positive, not {period_ns}")
        self._start_ns = start_ns
        self._period_ns = period_ns
        self.deadline_ns = start_ns
        self.index = 0
        self.skipped = 0

    def advance(self, now_ns: int) -> int:
        """Serve the period that is due and move to the first deadline after ``now_ns``.

        Returns the number of the period served. Raises ValueError before the deadline: serving
        early would put two steps into one period.
        """
        served, deadline_ns = self.index, self.deadline_ns
        next_ns = deadline_ns + self._period_ns
        if deadline_ns <= now_ns < next_ns:
            self.index, self.deadline_ns = served + 1, next_ns
            return served
        if now_ns < deadline_ns:
            raise ValueError(f"{deadline_ns - now_ns} ns too early for the next period")
        self.index = (now_ns - self._start_ns) // self._period_ns + 1
        self.deadline_ns = self._start_ns + self.index * self._period_ns
        self.skipped += self.index - served - 1
        return served
