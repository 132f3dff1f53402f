"""The broker's log of clients that leave: one line each with the reason, and counts by cause.

A disconnected client can come back at once, and every line takes time and may fill a pipe that
nobody reads. So the broker never waits for its reader, prints LINES_AT_ONCE and one more line every
LINE_PERIOD_NS, and counts the others.
"""

from collections import Counter
from collections.abc import Callable, Mapping
from enum import StrEnum

from ..node import NS_PER_S

LINES_AT_ONCE = 50
LINE_PERIOD_NS = NS_PER_S // 10


class Cause(StrEnum):
    """Why a client has left."""

    LEFT = "left"
    """An orderly end; printed only on request."""
    LOST = "lost"
    """Its connection broke, or ended in the middle of a record."""
    REFUSED = "refused"
    """It required another bus, or there were too many clients."""
    NO_HELLO = "no_hello"
    """It connected but sent no hello."""
    GARBAGE = "garbage"
    """It violated the protocol, or sent a frame that no CAN controller can send."""
    NOT_READING = "not_reading"
    """Too much data waited for it."""


class Journal:
    """Counts and reports disconnections.

    ``print_line``  takes one line and returns whether it could be printed without waiting
    ``is_verbose``  whether to print orderly joins and ends too

    ``unprinted``   lines that were not printed
    """

    def __init__(self, print_line: Callable[[str], bool], is_verbose: bool = False) -> None:
        self._print_line = print_line
        self._is_verbose = is_verbose
        self._causes: Counter[Cause] = Counter()
        self._lines_left = LINES_AT_ONCE
        self._counted_from_ns: int | None = None
        self.unprinted = self._unprinted_since = 0

    @property
    def disconnections(self) -> Mapping[str, int]:
        """How many clients have left, for every cause."""
        return {cause.value: self._causes[cause] for cause in Cause}

    def join(self, who: str, now_ns: int) -> None:
        """Record that a client has joined a channel."""
        if self._is_verbose:
            self.note(f"{who} joins", now_ns)

    def leave(self, who: str, cause: Cause, detail: str, now_ns: int) -> None:
        """Record that a client has left, and why."""
        self._causes[cause] += 1
        if cause is not Cause.LEFT or self._is_verbose:
            self.note(f"{who} leaves: {detail or 'it has closed the connection'}", now_ns)

    def note(self, line: str, now_ns: int) -> None:
        """Print a line, if one has become due since the last one."""
        if self._counted_from_ns is None:
            self._counted_from_ns = now_ns
        granted = (now_ns - self._counted_from_ns) // LINE_PERIOD_NS
        self._counted_from_ns += granted * LINE_PERIOD_NS
        self._lines_left = min(self._lines_left + granted, LINES_AT_ONCE)
        missing = f" ({self._unprinted_since} lines before this one were not printed)"
        if self._lines_left and self._print_line(line + missing * bool(self._unprinted_since)):
            self._lines_left -= 1
            self._unprinted_since = 0
        else:
            self.unprinted += 1
            self._unprinted_since += 1
