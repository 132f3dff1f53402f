"""The broker's log of clients that leave: one line each with the reason, and counts by cause."""

from collections import Counter
from collections.abc import Callable, Mapping
from enum import StrEnum


class Cause(StrEnum):
    """Why a client has left."""

    LEFT = "left"
    """An orderly end; printed only on request."""
    LOST = "lost"
    """Its connection broke, or ended in the middle of a record."""
    REFUSED = "refused"
    """It required another bus, or there were too many clients."""
    GARBAGE = "garbage"
    """It violated the protocol, or sent a frame that no CAN controller can send."""
    NOT_READING = "not_reading"
    """Too much data waited for it."""


class Journal:
    """Counts and reports disconnections.

    ``print_line``  prints one line, or drops it: the broker does not wait for its reader
    ``is_verbose``  whether to print orderly joins and ends too
    """

    def __init__(self, print_line: Callable[[str], object], is_verbose: bool = False) -> None:
        self._print_line = print_line
        self._is_verbose = is_verbose
        self._causes: Counter[Cause] = Counter()

    @property
    def disconnections(self) -> Mapping[str, int]:
        """How many clients have left, for every cause."""
        return {cause.value: self._causes[cause] for cause in Cause}

    def join(self, who: str) -> None:
        """Record that a client has joined a channel."""
        if self._is_verbose:
            self._print_line(f"{who} joins")

    def leave(self, who: str, cause: Cause, detail: str) -> None:
        """Record that a client has left, and why."""
        self._causes[cause] += 1
        if cause is not Cause.LEFT or self._is_verbose:
            self._print_line(f"{who} leaves: {detail or 'it has closed the connection'}")
