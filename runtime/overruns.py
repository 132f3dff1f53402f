"""Judges whether a node keeps its rate, by its own timer: too many overruns are a fault of its own.

A tick overruns when at least one period has passed unserved before it was done with: the timer
skips it. One stall is one overrun, however long it lasts; what that does to measurements and to the
peer is judged by their ages. A node that overruns in ever so many of its ticks is too slow for its
rate, or its host is, and no age shows that.

The time is the timer's, so this is the same in virtual time, and in real time whatever made the
node late.
"""

from collections import deque
from typing import Annotated, Any, Literal, Self

from pydantic import Discriminator, Field, Tag

from runtime.periodic import PeriodicTimer
from runtime.settings import Settings


def _word_or_number(value: Any) -> str:
    """Return which kind of bound a value is, so that a mistake in it is told once."""
    return "word" if isinstance(value, str) else "number"


class OverrunSettings(Settings):
    """How many overruns are borne.

    ``overruns_max``  among the last ``window_ticks``; 0 bears none, "off" bears all
    ``window_ticks``  how many ticks are looked back at
    """

    overruns_max: Annotated[
        Annotated[int, Field(ge=0, le=10_000), Tag("number")]
        | Annotated[Literal["off"], Tag("word")],
        Discriminator(_word_or_number),
    ] = 50
    window_ticks: Annotated[int, Field(ge=1, le=10_000)] = 100


class OverrunSupervision:
    """Counts the overruns of one periodic activity.

    ``overruns_max``, ``window_ticks``  as in OverrunSettings; ValueError outside their ranges
    """

    def __init__(self, overruns_max: int, window_ticks: int) -> None:
        if overruns_max < 0 or window_ticks < 1:
            raise ValueError(f"{overruns_max} overruns of {window_ticks} ticks cannot be allowed")
        self._overruns_max = overruns_max
        self._window: deque[bool] = deque(maxlen=window_ticks)
        self._overruns = 0
        self._total = 0
        self._worst = 0
        self._skipped_before = 0
        self._failure = ""

    @classmethod
    def of(cls, settings: OverrunSettings) -> Self:
        """Return the supervision that the settings ask for."""
        window_ticks = settings.window_ticks
        # No more of the ticks can overrun than there are.
        overruns_max = window_ticks if settings.overruns_max == "off" else settings.overruns_max
        return cls(overruns_max, window_ticks)

    @property
    def failure(self) -> str:
        """Why the rate is not kept; empty while it is. Once it is there it stays."""
        return self._failure

    @property
    def overruns(self) -> int:
        """Overruns so far."""
        return self._total

    @property
    def worst(self) -> int:
        """Most overruns among as many ticks as the window has."""
        return self._worst

    def on_tick(self, timer: PeriodicTimer) -> bool:
        """Note the tick that ``timer`` has advanced for; returns whether the rate is kept."""
        has_overrun = timer.skipped > self._skipped_before
        self._skipped_before = timer.skipped
        if len(self._window) == self._window.maxlen:
            self._overruns -= self._window[0]
        self._window.append(has_overrun)
        self._overruns += has_overrun
        self._total += has_overrun
        self._worst = max(self._worst, self._overruns)
        if self._overruns > self._overruns_max and not self._failure:
            self._failure = (
                f"{self._overruns} of the last {len(self._window)} ticks overran, "
                f"allowed are {self._overruns_max} of {self._window.maxlen}"
            )
        return not self._failure
