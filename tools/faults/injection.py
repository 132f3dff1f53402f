"""Injection of faults into a bus, and a record of what was done and when."""

import time
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from ...runtime.node import NS_PER_S
from ...runtime.port.port import ClosablePort
from .fault_frames import FrameSource

TURN_NS = 1_000_000
"""Pause when the bus is full: it carries four frames meanwhile and has 16 of ours ready."""
_WAIT_NS_MAX = 50_000_000
"""Longest time until a request to end takes effect."""
_RECEIVED_PER_TURN_MAX = 100


class Action(NamedTuple):
    """Something that was done.

    ``time_ns``  wall clock, as bus time stamps are
    ``since_s``  since the injector was ready [s]
    """

    time_ns: int
    since_s: float
    fault: str
    what: str


class Injection:
    """Runs faults on the bus of ``port``; ``report`` is called with each action when it is done."""

    def __init__(
        self,
        port: ClosablePort,
        sources: Sequence[FrameSource],
        start_ns: int,
        report: Callable[[Action], None],
    ) -> None:
        self._port = port
        self._start_ns = start_ns
        self._report = report
        self._waiting = list(sources)
        self._active: list[FrameSource] = []
        self._sent, self._refused = Counter[FrameSource](), Counter[FrameSource]()
        self.actions: list[Action] = []
        self.results: list[dict[str, Any]] = []

    def run(self, stop: Callable[[], bool]) -> bool:
        """Inject until all is over or ``stop``; returns whether all is over. Raises BusError."""
        while not stop():
            now_ns = time.monotonic_ns()
            was_refused = self._turn(now_ns)
            if not self._waiting and not self._active:
                return True
            self._listen(self._next_ns(now_ns, was_refused))
        for source in self._active:
            self._end(source, "cut short")
        return False

    def _turn(self, now_ns: int) -> bool:
        """Do what is due; returns whether the bus had no room."""
        for source in [one for one in self._waiting if one.onset_ns <= now_ns]:
            self._waiting.remove(source)
            self._active.append(source)
            self._note(source.fault.kind, "begins")
        was_refused = False
        for source in list(self._active):
            for frame in source.due(now_ns):
                if not self._send(source, frame):
                    was_refused = True
                    break
            if now_ns >= source.end_ns:
                self._active.remove(source)
                self._end(source, "ends")
        return was_refused

    def _send(self, source: FrameSource, frame: Any) -> bool:
        has_room = self._port.send(frame)
        (self._sent if has_room else self._refused)[source] += 1
        return has_room

    def _next_ns(self, now_ns: int, was_refused: bool) -> int:
        times = [one.onset_ns for one in self._waiting]
        times += [min(one.next_due_ns, one.end_ns) for one in self._active]
        earliest_ns = now_ns + (TURN_NS if was_refused else 0)
        return max(min([*times, now_ns + _WAIT_NS_MAX]), earliest_ns)

    def _listen(self, until_ns: int) -> None:
        """Receive frames until then; faults that listen answer at once."""
        for _ in range(_RECEIVED_PER_TURN_MAX):
            received = self._port.recv(max(until_ns - time.monotonic_ns(), 0) / NS_PER_S)
            if received is None:
                return
            for source in self._active:
                for answer in source.on_frame(received.frame, time.monotonic_ns()):
                    self._send(source, answer)

    def _end(self, source: FrameSource, how: str) -> None:
        sent, refused = self._sent[source], self._refused[source]
        self.results.append({"fault": source.fault._asdict(), "sent": sent, "refused": refused})
        full = f", {refused} times no room" if refused else ""
        self._note(source.fault.kind, f"{how}: {sent} frames sent{full}")

    def _note(self, fault: str, what: str) -> None:
        since_s = (time.monotonic_ns() - self._start_ns) / NS_PER_S
        action = Action(time.time_ns(), since_s, str(fault), what)
        self.actions.append(action)
        self._report(action)
