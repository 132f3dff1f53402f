"""Overruns: a node's own timer shows whether it keeps its rate; not to do so is its fault.

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

from typing import Annotated, NamedTuple

from pydantic import Field, Tag

from ..settings import NUMBER_OR_WORD, OffWord, Settings
from .periodic import PeriodicTimer

_MOST = 10_000
_Bound = Annotated[Annotated[int, Field(ge=0, le=_MOST), Tag("number")] | OffWord, NUMBER_OR_WORD]
_Count = Annotated[int, Field(ge=1, le=_MOST)]


class OverrunSettings(Settings):
    """How many overruns and missed periods are allowed; 0 allows none, "off" any number.

    ``overruns_max``        among the last ``window_ticks``
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


class OverrunRule(NamedTuple):
    """The limits of OverrunSettings, as numbers."""

    overruns_max: int
    window_ticks: int
    missed_periods_max: int
    window_periods: int
    stall_periods_max: int


def overrun_rule(table: OverrunSettings) -> OverrunRule:
    """Return the rule of settings; "off" allows as many as the window has."""
    overruns_max, missed_max = table.overruns_max, table.missed_periods_max
    return OverrunRule(
        table.window_ticks if isinstance(overruns_max, str) else overruns_max,
        table.window_ticks,
        table.window_periods if isinstance(missed_max, str) else missed_max,
        table.window_periods,
        table.stall_periods_max,
    )


class Overruns(NamedTuple):
    """The overruns of the last ticks and the missed ones of the last periods, as far as counted.

    ``ticks``, ``periods``  so far
    """

    ticks: int
    periods: int
    overruns: int
    missed: int


NO_OVERRUNS = Overruns(0, 0, 0, 0)


def counted_periods(p: OverrunRule, missed: int) -> int:
    """Return how many of the periods missed with a tick count."""
    return min(missed, p.stall_periods_max)


def overrun_step(x: Overruns, counted: int, overruns_left: int, missed_left: int) -> Overruns:
    """Process a tick, with which some periods were missed.

    ``counted``        missed periods, as far as they count
    ``overruns_left``  overruns among the ticks that leave the window with this one
    ``missed_left``    missed ones among the periods that leave it
    """
    overran = 1 if counted > 0 else 0
    return Overruns(
        x.ticks + 1,
        x.periods + 1 + counted,
        x.overruns + overran - overruns_left,
        x.missed + counted - missed_left,
    )


def keeps_rate(p: OverrunRule, x: Overruns) -> bool:
    """Whether neither limit is exceeded."""
    return x.overruns <= p.overruns_max and x.missed <= p.missed_periods_max


class OverrunSupervision:
    """Counts overruns and missed periods of one periodic activity.

    ``failure``   why the rate is not kept, for good; empty while it is kept
    """

    def __init__(self, rule: OverrunRule) -> None:
        self._rule = rule
        self._x = NO_OVERRUNS
        self._overran = bytearray(rule.window_ticks)
        self._was_missed = bytearray(rule.window_periods)
        """Rings: 1 for a tick that overran and for a period that was missed."""
        self._is_calm = True
        """Whether the rings hold zeros alone."""
        self._skipped_before = self._calm_ticks = 0
        self.failure = ""

    def on_tick(self, timer: PeriodicTimer) -> bool:
        """Process the tick that ``timer`` has advanced for; returns whether the rate is kept."""
        missed = timer.skipped - self._skipped_before
        if self._is_calm and not missed:
            self._calm_ticks += 1
            return True
        self._skipped_before = timer.skipped
        rule, calm = self._rule, self._calm_ticks
        x = self._x._replace(ticks=self._x.ticks + calm, periods=self._x.periods + calm)
        self._calm_ticks = 0
        counted = counted_periods(rule, missed)
        overruns_left = _replaced(self._overran, x.ticks, 1 if counted else 0)
        missed_left = sum(
            _replaced(self._was_missed, x.periods + index, 1 if index else 0)
            for index in range(1 + counted)
        )
        self._x = x = overrun_step(x, counted, overruns_left, missed_left)
        if not self.failure and not keeps_rate(rule, x):
            self.failure = _in_words(rule, x)
        self._is_calm = not (x.overruns or x.missed or self.failure)
        return not self.failure


def _replaced(ring: bytearray, index: int, value: int) -> int:
    place = index % len(ring)
    left, ring[place] = ring[place], value
    return left


def _in_words(p: OverrunRule, x: Overruns) -> str:
    if x.overruns > p.overruns_max:
        return (
            f"{x.overruns} of the last {min(x.ticks, p.window_ticks)} ticks overran, allowed are "
            f"{p.overruns_max} of {p.window_ticks}"
        )
    return (
        f"{x.missed} of the last {min(x.periods, p.window_periods)} periods were missed, a "
        f"stall counted as {p.stall_periods_max} at most, allowed are {p.missed_periods_max} of "
        f"{p.window_periods}"
    )
