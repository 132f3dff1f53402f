"""The node that a program or library in lockstep is on the bus."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from ...controller.node.node import ControllerNode
from ...controller.settings import ControllerSettings
from ...runtime.frame import Frame
from ...runtime.node import NEVER_NS, NS_PER_S, View
from ..processes.process_group import ProcessError
from .peer import LockstepPeer, lockstep_peer
from .record import DEADLINE, FRAMES, FRAMES_MAX, START, WAKE_ON_FRAMES, Arrival, Record

WAKES_MAX = 100_000
"""In a second of the run: with more, deadlines a nanosecond apart would never let it end."""


class LockstepNode:
    """A node whose decisions a program makes, each by one exchange.

    ``program``   is asked from here only
    ``start_ns``  when it is woken first [ns]

    ``deadline_ns``, ``finished``  of the program; it has finished when it fails
    """

    def __init__(self, program: LockstepPeer, start_ns: int) -> None:
        self._program = program
        self._waiting: list[Arrival] = []
        self._wakes_on_frames = False
        self._counts = {"wakes": 0, "frames_received": 0, "frames_sent": 0}
        self.failure = ""
        self.deadline_ns, self.finished = start_ns, False
        self._reason = START
        self._second, self._wakes_in_second = 0, 0

    def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:
        """Keep a frame for the program, or wake it."""
        if self.finished or self._reason == START:
            return ()
        self._counts["frames_received"] += 1
        self._waiting.append((now_ns, frame))
        if self._wakes_on_frames or len(self._waiting) == FRAMES_MAX:
            return self._wake(FRAMES, now_ns)
        return ()

    def on_tick(self, now_ns: int) -> Sequence[Frame]:
        """Wake the program at its deadline."""
        reason, self._reason = self._reason, DEADLINE
        return self._wake(reason, now_ns)

    def _wake(self, reason: int, now_ns: int) -> Sequence[Frame]:
        waiting, self._waiting = self._waiting, []
        before_ns = self.deadline_ns
        self._counts["wakes"] += 1
        try:
            self._refuse_haste(now_ns)
            flags, self.deadline_ns, frames = self._program.exchange(
                Record(reason, now_ns, waiting)
            )
            is_as_it_was = reason == FRAMES and self.deadline_ns == before_ns
            if self.deadline_ns <= now_ns - (reason != DEADLINE) and not is_as_it_was:
                raise ProcessError(
                    f"{self._program.name}: its next deadline, {self.deadline_ns} ns, is not"
                    f" after now, {now_ns} ns"
                )
        except ProcessError as error:
            self.failure = f"at {now_ns / NS_PER_S:.3f} s: {error}"
            self.deadline_ns, self.finished = NEVER_NS, True
            return ()
        self._wakes_on_frames = bool(flags & WAKE_ON_FRAMES)
        self._counts["frames_sent"] += len(frames)
        return [frame for _, frame in frames]

    def _refuse_haste(self, now_ns: int) -> None:
        second = now_ns // NS_PER_S
        self._wakes_in_second = self._wakes_in_second + 1 if second == self._second else 1
        self._second = second
        if self._wakes_in_second > WAKES_MAX:
            raise ProcessError(f"{self._program.name}: woken more than {WAKES_MAX} times a second")

    def on_unauthenticated(self) -> None:
        """Frames of a lockstep run are not authenticated before they arrive."""

    def view(self, now_ns: int) -> View:  # noqa: ARG002 the counts are those of now
        """Return its counts."""
        return View({}, self._counts, self._program.name)

    def report(self) -> Mapping[str, Any]:
        """Return its counts, and how the program failed, if it did."""
        return {"program": self._program.name, **self._counts, "failure": self.failure}


@contextmanager
def controller_node(
    controller: ControllerSettings | Sequence[str], samples_max: int = 0
) -> Iterator[ControllerNode | LockstepNode]:
    """Make the controller of a run that begins at 0, by its settings or a program's words.

    ``samples_max``  how many samples our own keeps

    Raises ProcessError when the program cannot be started.
    """
    if isinstance(controller, ControllerSettings):
        yield ControllerNode(controller, 0, samples_max)
        return
    with lockstep_peer(controller) as program:
        yield LockstepNode(program, 0)
