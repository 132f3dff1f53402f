"""A node that misses frames: those that its receiver alone saw wrong, and all in bus-off."""

from collections.abc import Sequence

from ..runtime.bus_model.bus_model import BusModel
from ..runtime.frame import Frame
from ..runtime.node import Node


class Ear:
    """Stands before ``node``, member ``index`` of the bus ``model``.

    ``deadline_ns``, ``finished``  of the node
    """

    def __init__(self, node: Node, index: int, model: BusModel) -> None:
        self._node, self._index = node, index
        self._missed, self._access = model.missed, model.access
        self.deadline_ns, self.finished = node.deadline_ns, node.finished

    def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:
        """Pass a frame to the node, unless it is one that it misses."""
        if self._missed and (key := (now_ns, self._index)) in self._missed:
            self._missed.discard(key)
            return ()
        if self._access.is_off_at(self._index, now_ns):
            return ()
        frames = self._node.on_frame(frame, now_ns)
        self.deadline_ns, self.finished = self._node.deadline_ns, self._node.finished
        return frames

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        """Let the node tick."""
        frames = self._node.on_tick(now_ns)
        self.deadline_ns, self.finished = self._node.deadline_ns, self._node.finished
        return frames
