"""A node that misses frames: those that its receiver alone saw wrong, and all in bus-off."""

from collections.abc import Sequence

from .bus_model import BusModel
from .frame import Frame
from .node import Node


class Ear:
    """Stands before ``node``, member ``index`` of the bus ``model``."""

    def __init__(self, node: Node, index: int, model: BusModel) -> None:
        self._node, self._index, self._model = node, index, model

    @property
    def deadline_ns(self) -> int:
        """When the node's next tick is due [ns]."""
        return self._node.deadline_ns

    @property
    def finished(self) -> bool:
        """Whether the node has finished."""
        return self._node.finished

    def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:
        """Pass a frame to the node, unless it is one that it misses."""
        key = (now_ns, self._index)
        if key in self._model.missed:
            self._model.missed.discard(key)
            return ()
        if self._model.participation.is_off_at(self._index, now_ns):
            return ()
        return self._node.on_frame(frame, now_ns)

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        """Let the node tick."""
        return self._node.on_tick(now_ns)
