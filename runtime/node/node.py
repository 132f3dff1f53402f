"""Node: an object without clock, socket, thread or print that an executor runs; and its live view.

Rules an executor keeps:

1. It reads the clock at a wake-up, hands over every waiting frame (``on_frame``), then ticks
   (``on_tick``) if ``now_ns >= deadline_ns``; frames that leave are the return values, in order.
   A frame comes with its arrival time if that is known, otherwise with a reading of the clock
   that is later.
2. Times are integer nanoseconds on one monotonic clock; those passed to a node never decrease.
3. ``on_tick`` is called again at the same ``now_ns`` while ``deadline_ns <= now_ns``.

Rules a node keeps:

1. ``on_tick`` moves ``deadline_ns`` beyond ``now_ns`` within a bounded number of calls.
2. A periodic deadline is ``start_ns + index * period_ns``; missed periods are counted, never made
   up.
3. It raises for nothing that comes over the wire.
4. ``deadline_ns`` and ``finished`` change in its own ``on_frame`` and ``on_tick`` only.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

from ..frame import Frame

NS_PER_S = 1_000_000_000
NS_PER_MS = 1_000_000
NS_PER_US = 1_000
NEVER_NS = 2**63 - 1
"""A deadline that never comes."""


class Node(Protocol):
    """One participant on the bus."""

    @property
    def deadline_ns(self) -> int:
        """When ``on_tick`` wants to be called next [ns]."""

    @property
    def finished(self) -> bool:
        """Whether the node has nothing left to do, so that the run may end."""

    def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:
        """Take a frame that arrived at ``now_ns``; return the frames to send."""

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        """Do all that is due at ``now_ns``; return the frames to send."""


class View(NamedTuple):
    """A node at one time, in words for the user. To show more, a node adds a row.

    ``states``  what holds now, by a name of its own; empty where there is nothing to report
    ``counts``  what has happened, and how often since the start
    ``now``     figures of the moment, for one line of a terminal
    """

    states: Mapping[str, str]
    counts: Mapping[str, int]
    now: str


class ReportingNode(Node, Protocol):
    """A node of a program: it has a view and a report, and learns of frames refused before it."""

    def on_unauthenticated(self) -> None:
        """Note that a frame was refused before it came here."""

    def view(self, now_ns: int) -> View:
        """Return what a user should see at ``now_ns``; asked for often, so it must be quick."""

    def report(self) -> Mapping[str, Any]:
        """Return the figures of the run so far: numbers, texts, and mappings of them.

        ``failure``  optional: why the node is no longer reliable, because it does not keep its
                     rate or its result was not finite. Such a node enters its safe state for good,
                     reports this on the bus, and has then ``finished``
        """


N = TypeVar("N", bound=ReportingNode)


class Wrapper(ReportingNode, Generic[N]):
    """Forwards everything to ``node``; subclasses override what differs.

    The protocol is its base, so that mypy refuses a wrapper that lacks a method.
    """

    def __init__(self, node: N) -> None:
        self.node = node

    @property
    def deadline_ns(self) -> int:
        """When the node's next tick is due [ns]."""
        return self.node.deadline_ns

    @property
    def finished(self) -> bool:
        """Whether the node has finished."""
        return self.node.finished

    def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:
        """Pass a frame to the node."""
        return self.node.on_frame(frame, now_ns)

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        """Let the node tick."""
        return self.node.on_tick(now_ns)

    def on_unauthenticated(self) -> None:
        """Notify the node of a frame that was refused before it."""
        self.node.on_unauthenticated()

    def view(self, now_ns: int) -> View:
        """Return the node's view."""
        return self.node.view(now_ns)

    def report(self) -> Mapping[str, Any]:
        """Return the node's report."""
        return self.node.report()


def innermost(node: ReportingNode) -> Any:
    """Return the node that stands behind all wrappers."""
    while isinstance(node, Wrapper):
        node = node.node
    return node
