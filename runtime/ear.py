"""A node that misses the frames which its receiver alone saw wrong."""

from collections.abc import Sequence

from .frame import Frame
from .node import Node


class Ear:
    """Stands before ``node``, member ``index`` of a bus whose model lists what was ``missed``."""

    def __init__(self, node: Node, index: int, missed: set[tuple[int, int]]) -> None:
        self._node, self._index, self._missed = node, index, missed

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
        if key in self._missed:
            self._missed.discard(key)
            return ()
        return self._node.on_frame(frame, now_ns)

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        """Let the node tick."""
        return self._node.on_tick(now_ns)
