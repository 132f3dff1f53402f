"""Checks by a node's own timer whether it keeps its rate; not to do so is a fault of the node.

A tick overruns if at least one period passes before it is done; the timer skips such periods. The
effect of a stall on measurements and on the peer shows in their ages. Two limits cover what no age
shows:

    overruns         how many of the last ticks may overrun; one stall is one overrun, however long
    missed periods   how many of the last periods may be missed; a stall counts as
                     ``stall_periods_max`` at most, both as missed and in the window

The first detects a node that is too slow for its rate, the second a host that gives the node too
little time. A process that is stopped for seconds, or a machine that sleeps for an hour, is only
one stall.

The time is the timer's, so this works the same in virtual and in real time.
"""

from collections import deque
from typing import Annotated, Self

from pydantic import Field, Tag

from ..settings import NUMBER_OR_WORD, OffWord, Settings
from .periodic import PeriodicTimer

_MOST = 10_000
_Bound = Annotated[Annotated[int, Field(ge=0, le=_MOST), Tag("number")] | OffWord, NUMBER_OR_WORD]
_Count = Annotated[int, Field(ge=1, le=_MOST)]


class OverrunSettings(Settings):
    """How many overruns and missed periods are allowed; 0 allows none, "off" any number.

    ``overruns_max``        among the last ``window_ticks``
    ``window_ticks``        length of the window [ticks]
    ``missed_periods_max``  among the last ``window_periods``
    ``window_periods``      length of the window [periods], served or missed
    ``stall_periods_max``   largest count of one stall; above ``missed_periods_max``, one long stall
                            is a fault
    """

    overruns_max: _Bound = 50
    window_ticks: _Count = 100
    missed_periods_max: _Bound = 500
    window_periods: _Count = 1000
    stall_periods_max: _Count = 250


class MissedPeriods:
    """Counts missed periods in the window; raises ValueError outside OverrunSettings' ranges."""

    def __init__(self, missed_max: int, window_periods: int, stall_max: int) -> None:
        if missed_max < 0 or window_periods < 1 or stall_max < 1:
            raise ValueError(
                f"{missed_max} of {window_periods} periods, {stall_max} of a stall, cannot be "
                "allowed"
            )
        self._missed_max = missed_max
        self._window = window_periods
        self._stall_max = stall_max
        self._counted = 0
        """Missed periods so far, as far as they count."""
        self._stalls: deque[tuple[int, int]] = deque()
        """Stalls that reach into the window: end [periods, as far as they count], and count."""
        self._missed = 0

    @property
    def is_calm(self) -> bool:
        """Whether no stall reaches into the window; a tick in time then only adds a period."""
        return not self._stalls

    def on_tick(self, ticks: int, missed: int) -> str:
        """Process a tick, ``ticks`` so far, and the number of periods missed with it.

        Returns why they are too many, and an empty text where they are not.
        """
        counted = min(missed, self._stall_max)
        self._counted += counted
        periods = ticks + self._counted
        if counted:
            self._missed += counted
            self._stalls.append((periods, counted))
        begin = periods - self._window
        while self._stalls and self._stalls[0][0] <= begin:
            self._missed -= self._stalls.popleft()[1]
        in_window = self._missed
        if self._stalls:
            end, counted = self._stalls[0]
            in_window -= max(0, begin - (end - counted))
        if in_window <= self._missed_max:
            return ""
        return (
            f"{in_window} of the last {min(periods, self._window)} periods were missed, a "
            f"stall counted as {self._stall_max} at most, allowed are {self._missed_max} of "
            f"{self._window}"
        )


class OverrunSupervision:
    """Counts overruns and missed periods of one periodic activity.

    ``overruns_max``, ``window_ticks``  as in OverrunSettings; ValueError outside their ranges
    ``missed``                          checks the missed periods; None: any number is allowed

    ``failure``   why the rate is not kept, for good; empty while it is kept
    ``overruns``  so far; ``worst`` most of them in a window
    """

    def __init__(
        self, overruns_max: int, window_ticks: int, missed: MissedPeriods | None = None
    ) -> None:
        if overruns_max < 0 or window_ticks < 1:
            raise ValueError(f"{overruns_max} overruns of {window_ticks} ticks cannot be allowed")
        self._overruns_max = overruns_max
        self._window_ticks = window_ticks
        self._ticks = 0
        self._recent: deque[int] = deque()
        """Numbers of the ticks in the window that overran."""
        self._missed = missed
        self._skipped_before = self.overruns = self.worst = 0
        self._is_calm = True
        self.failure = ""

    @classmethod
    def of(cls, settings: OverrunSettings) -> Self:
        """Return the supervision for settings."""
        window_ticks = settings.window_ticks
        # No more ticks can overrun than the window has.
        overruns_max = window_ticks if settings.overruns_max == "off" else settings.overruns_max
        missed = None
        if settings.missed_periods_max != "off":
            missed = MissedPeriods(
                settings.missed_periods_max, settings.window_periods, settings.stall_periods_max
            )
        return cls(overruns_max, window_ticks, missed)

    def on_tick(self, timer: PeriodicTimer) -> bool:
        """Process the tick that ``timer`` has advanced for; returns whether the rate is kept."""
        self._ticks += 1
        missed = timer.skipped - self._skipped_before
        if self._is_calm and not missed:
            return True
        recent = self._recent
        if missed:
            self._skipped_before = timer.skipped
            recent.append(self._ticks)
            self.overruns += 1
        if recent:
            if recent[0] <= self._ticks - self._window_ticks:
                recent.popleft()
            self.worst = max(self.worst, len(recent))
        too_many_missed = "" if self._missed is None else self._missed.on_tick(self._ticks, missed)
        if not self.failure and (recent or too_many_missed):
            self.failure = self._too_many_overruns() or too_many_missed
        self._is_calm = not (recent or self.failure) and (
            self._missed is None or self._missed.is_calm
        )
        return not self.failure

    def _too_many_overruns(self) -> str:
        if len(self._recent) <= self._overruns_max:
            return ""
        return (
            f"{len(self._recent)} of the last {min(self._ticks, self._window_ticks)} ticks overran,"
            f" allowed are {self._overruns_max} of {self._window_ticks}"
        )
