"""Faults of a whole node in virtual time: killed, paused, bus-off, a clock that jumps."""

from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

from ....runtime.frame import Frame
from ....runtime.node import NEVER_NS, NS_PER_S, ReportingNode, Wrapper
from .campaign_file import NodeFaultKind

SOCKET_FRAMES_MAX = 1000
"""Frames that wait for a paused program; the newest are lost when the queue is full."""


class NodeFault(NamedTuple):
    """A fault of a node, its times in the run, and its magnitude by kind."""

    kind: NodeFaultKind
    node: str
    onset_s: float
    duration_s: float
    magnitude: float = 1.0

    @property
    def window_ns(self) -> tuple[int, int]:
        """Start and end [ns]; a node that is killed stays so."""
        onset_ns = round(self.onset_s * NS_PER_S)
        if self.kind is NodeFaultKind.KILLED:
            return onset_ns, NEVER_NS
        return onset_ns, onset_ns + round(self.duration_s * NS_PER_S)


class Stricken(Wrapper[ReportingNode]):
    """A node that is killed, paused or off the bus from one time to another."""

    def __init__(self, node: ReportingNode, fault: NodeFault) -> None:
        super().__init__(node)
        self._kind = fault.kind
        self._onset_ns, self._end_ns = fault.window_ns
        self._waiting: deque[Frame] = deque()

    @property
    def deadline_ns(self) -> int:
        """When it can next act [ns]."""
        deadline_ns = self.node.deadline_ns
        if self._kind is NodeFaultKind.BUS_OFF or deadline_ns < self._onset_ns:
            return deadline_ns
        return max(deadline_ns, self._end_ns)

    def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:
        """Take a frame, unless the fault keeps it away."""
        if self._onset_ns <= now_ns < self._end_ns:
            if self._kind is NodeFaultKind.PAUSED and len(self._waiting) < SOCKET_FRAMES_MAX:
                self._waiting.append(frame)
            return ()
        return [*self._catch_up(now_ns), *self.node.on_frame(frame, now_ns)]

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        """Do what is due; what a node that is off the bus sends is lost."""
        sent = [*self._catch_up(now_ns), *self.node.on_tick(now_ns)]
        return () if self._onset_ns <= now_ns < self._end_ns else sent

    def _catch_up(self, now_ns: int) -> Sequence[Frame]:
        """Take the frames that have waited."""
        answers = [answer for one in self._waiting for answer in self.node.on_frame(one, now_ns)]
        self._waiting.clear()
        return answers


class JumpingClock(Wrapper[ReportingNode]):
    """A node whose clock goes ahead by ``jump_ns`` at ``onset_ns``."""

    def __init__(self, node: ReportingNode, onset_ns: int, jump_ns: int) -> None:
        super().__init__(node)
        self._onset_ns = onset_ns
        self._jump_ns = jump_ns
        self._ahead_ns = 0

    @property
    def deadline_ns(self) -> int:
        """When its next tick is due, on the clock of the others [ns]."""
        deadline_ns = self.node.deadline_ns - self._ahead_ns
        return deadline_ns if self._ahead_ns else min(deadline_ns, self._onset_ns)

    def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:
        """Take a frame at the time that its own clock shows."""
        return self.node.on_frame(frame, self._shown_ns(now_ns))

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        """Do what is due by its own clock."""
        shown_ns = self._shown_ns(now_ns)
        return self.node.on_tick(shown_ns) if self.node.deadline_ns <= shown_ns else ()

    def _shown_ns(self, now_ns: int) -> int:
        if now_ns >= self._onset_ns:
            self._ahead_ns = self._jump_ns
        return now_ns + self._ahead_ns


def with_node_faults(node: ReportingNode, name: str, faults: Sequence[NodeFault]) -> ReportingNode:
    """Return the node with those of the faults that are this node's."""
    own = [fault for fault in faults if fault.node == name]
    jumps = [fault for fault in own if fault.kind is NodeFaultKind.CLOCK_JUMP]
    # Pauses are inside: they have no clock of their own. The later of two jumps is around the
    # earlier, since it would otherwise bring the earlier one's onset forward.
    for jump in sorted(jumps, key=lambda fault: fault.onset_s):
        node = JumpingClock(node, jump.window_ns[0], round(jump.magnitude * NS_PER_S))
    for fault in own:
        if fault.kind is not NodeFaultKind.CLOCK_JUMP:
            node = Stricken(node, fault)
    return node
