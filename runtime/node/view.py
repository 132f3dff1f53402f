"""What a node shows of itself while it runs, and which lines its changes are worth.

A node returns a ``View``; ``Changes`` compares each with those before. To show something more, a
node adds one row to its view. However fast things change, the lines stay few: a state has at most
STATE_LINES at once and one every STATE_NS after that, a count one every COUNT_NS.
"""

from collections.abc import Iterator, Mapping
from typing import NamedTuple

STATE_LINES = 4
STATE_NS = 2_000_000_000
COUNT_NS = 5_000_000_000


class View(NamedTuple):
    """A node at one time, in words for the user.

    ``states``  what holds now, by a name of its own; empty where there is nothing to report
    ``counts``  what has happened, and how often since the start
    ``now``     figures of the moment, for one line of a terminal
    """

    states: Mapping[str, str]
    counts: Mapping[str, int]
    now: str


class Changes:
    """Compares views, and remembers what was printed."""

    def __init__(self) -> None:
        self._states: dict[str, str] = {}
        self._counts: dict[str, int] = {}
        self._free_ns: dict[str, int] = {}

    def lines(self, view: View, now_ns: int) -> Iterator[str]:
        """Return a line for each state and count that differs from what was printed of it."""
        for name, text in view.states.items():
            if text != self._states.get(name, "") and self._may(
                name, now_ns, STATE_NS, STATE_LINES
            ):
                self._states[name] = text
                if text:
                    yield text
        for name, count in view.counts.items():
            rise = count - self._counts.get(name, 0)
            if rise and self._may(name, now_ns, COUNT_NS, 1):
                self._counts[name] = count
                yield f"{name}: {rise}" if rise == count else f"{name}: {rise} more, {count} so far"

    def _may(self, name: str, now_ns: int, every_ns: int, at_once: int) -> bool:
        """Whether a line about ``name`` is due: ``at_once`` of them, then one each ``every_ns``."""
        free_ns = max(self._free_ns.get(name, now_ns), now_ns)
        if free_ns - now_ns > (at_once - 1) * every_ns:
            return False
        self._free_ns[name] = free_ns + every_ns
        return True
