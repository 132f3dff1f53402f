"""A node that only sends: somebody by hand, or an intruder."""

from collections.abc import Iterable, Sequence

from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node import NEVER_NS


class TimedSender:
    """Sends each frame at its time [ns]."""

    finished = False

    def __init__(self, timed: Iterable[tuple[int, Frame]]) -> None:
        self._timed = iter(timed)
        self._next = next(self._timed, None)
        self.sent = 0

    @property
    def deadline_ns(self) -> int:
        return NEVER_NS if self._next is None else self._next[0]

    def on_frame(self, _frame: Frame, _now_ns: int) -> Sequence[Frame]:
        return ()

    def on_tick(self, _now_ns: int) -> Sequence[Frame]:
        assert self._next is not None
        (_, frame), self._next = self._next, next(self._timed, None)
        self.sent += 1
        return [frame]
