"""Run of nodes in one process in virtual time: deterministic, and as fast as they compute.

Order at one instant:

1. Every frame of a node that is complete on the wire is delivered, in order of completion, to every
   node but its sender, in the sequence of the nodes. Their answers go to the wire at once.
2. When nothing is left to deliver, the first node in the sequence whose deadline is due ticks,
   and step 1 follows.
3. When no node is due either, time jumps to the next deadline or the next completion of a frame.
   A deadline in the past is due now: time never decreases.

With nodes in the sequence (plant, controller) and no time on the wire, the plant senses, the
measurements arrive, the controller decides, and the command arrives: all at one instant, as in a
textbook sampled-data loop.
"""

from collections.abc import Callable, Sequence
from typing import Protocol

from ..frame import Frame
from .node import NEVER_NS, Node

EVENTS_PER_INSTANT_MAX = 10_000
"""Deliveries and ticks at one instant before it counts as a livelock. Real nodes need some tens."""


_BEFORE_ALL_NS = -NEVER_NS
"""Before every deadline, also one in the past."""

Delivered = tuple[int, int, Frame]
"""When a frame was complete on the wire [ns], the index of its sender, and the frame."""


class Wire(Protocol):
    """Carries frames between the nodes and takes time, as a BusModel with a bit rate."""

    next_event_ns: int
    """When the next frame is complete [ns]; NEVER_NS with nothing on the way."""

    def submit(self, frames: Sequence[Frame], sender: int, now_ns: int) -> None:
        """Take frames to send at ``now_ns``, in order."""

    def advance(self, now_ns: int) -> Sequence[Delivered]:
        """Return the frames completed up to ``now_ns``, in order of completion."""


class InstantWire:
    """A wire that takes no time: frames are complete at once, in order."""

    def __init__(self) -> None:
        self.next_event_ns = NEVER_NS
        self._sent: list[Delivered] = []

    def submit(self, frames: Sequence[Frame], sender: int, now_ns: int) -> None:
        """Take frames to send at ``now_ns``, in order."""
        self._sent += [(now_ns, sender, frame) for frame in frames]
        self.next_event_ns = now_ns

    def advance(self, now_ns: int) -> Sequence[Delivered]:  # noqa: ARG002 all are complete
        """Return all frames submitted since the last call."""
        completed, self._sent, self.next_event_ns = self._sent, [], NEVER_NS
        return completed


class VirtualTimeExecutor:
    """Runs ``nodes`` over ``bus``.

    ``nodes``    in the order in which they tick at one instant
    ``bus``      the wire between them; an InstantWire unless given
    ``on_wire``  called as ``on_wire(time_ns, sender_index, frame)`` for every frame when it is
                 complete on the wire, before its delivery

    ``now_ns``   the instant that was run last [ns]; before the first one, that of the first one
    """

    def __init__(
        self,
        nodes: Sequence[Node],
        bus: Wire | None = None,
        on_wire: Callable[[int, int, Frame], None] | None = None,
    ) -> None:
        self._nodes = tuple(nodes)
        everyone = tuple(enumerate(nodes))
        self._receivers_of = {
            sender: everyone[:sender] + everyone[sender + 1 :] for sender, _ in everyone
        }
        self._wire = InstantWire() if bus is None else bus
        self._on_wire = on_wire
        self.now_ns = min((node.deadline_ns for node in nodes), default=0)

    @property
    def finished(self) -> bool:
        """Whether a node has finished; the run ends with the first one."""
        return any(node.finished for node in self._nodes)

    def run(self, until_ns: int) -> None:
        """Run every instant before ``until_ns``, or until a node has finished.

        ``run(a)`` and then ``run(b)`` is the same as ``run(b)``, and ``run(NEVER_NS)`` ends when
        nothing is left to wait for. Raises RuntimeError for a livelock of the nodes, and what the
        bus raises when it cannot take a frame.
        """
        wire, on_wire, nodes = self._wire, self._on_wire, tuple(enumerate(self._nodes))
        receivers_of, has_finished = self._receivers_of, self.finished
        now_ns, events, busy_index = _BEFORE_ALL_NS, 0, 0
        while events < EVENTS_PER_INSTANT_MAX:
            next_ns, due = wire.next_event_ns, None
            if next_ns > now_ns:
                for one in nodes:
                    deadline_ns = one[1].deadline_ns
                    if deadline_ns < next_ns:
                        next_ns, due = deadline_ns, one
                        if deadline_ns <= now_ns:
                            break
                if next_ns > now_ns:  # Nothing is left to do at this instant.
                    if next_ns >= until_ns or has_finished:
                        return
                    self.now_ns = now_ns = next_ns
                    events = 0
            if due is not None:
                busy_index, node = due
                events += 1
                if frames := node.on_tick(now_ns):
                    wire.submit(frames, busy_index, now_ns)
                if node.finished:
                    has_finished = True
                continue
            for end_ns, busy_index, frame in wire.advance(now_ns):
                if on_wire is not None:
                    on_wire(end_ns, busy_index, frame)
                for index, node in receivers_of.get(busy_index, ()):
                    events += 1
                    if frames := node.on_frame(frame, now_ns):
                        wire.submit(frames, index, now_ns)
                    if node.finished:
                        has_finished = True
        raise RuntimeError(
            f"node {busy_index} is still busy after {events} events at {now_ns} ns: "
            "its deadline does not move on, or its frames are answered without end"
        )
