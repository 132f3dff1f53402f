"""A node whose process does not run for a while, as under SIGSTOP; its frames wait."""

from collections.abc import Sequence

from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node import Node

Stall = tuple[int, int]
"""Its first instant, and the instant after it [ns]."""


class HeldUp:
    """A node whose process is held up during a stall."""

    finished = False

    def __init__(self, node: Node, stall: Stall) -> None:
        self._node = node
        self._first_ns, self._end_ns = stall
        self._waiting: list[Frame] = []

    @property
    def deadline_ns(self) -> int:
        deadline_ns = self._end_ns if self._waiting else self._node.deadline_ns
        return self._end_ns if self._is_stalled(deadline_ns) else deadline_ns

    def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:
        if self._is_stalled(now_ns):
            self._waiting.append(frame)
            return ()
        return [*self._take_waiting(now_ns), *self._node.on_frame(frame, now_ns)]

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        sent = self._take_waiting(now_ns)
        while self._node.deadline_ns <= now_ns:
            sent += self._node.on_tick(now_ns)
        return sent

    def _is_stalled(self, time_ns: int) -> bool:
        return self._first_ns <= time_ns < self._end_ns

    def _take_waiting(self, now_ns: int) -> list[Frame]:
        waiting, self._waiting = self._waiting, []
        return [answer for frame in waiting for answer in self._node.on_frame(frame, now_ns)]
