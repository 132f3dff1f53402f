"""The user's view of a running node: a line for each change, on a terminal also a status line.

The loop of the node never waits for it. Between two ticks, ``Observer`` compares and formats, which
takes some ten microseconds; a thread of its own writes. A terminal that is stopped or a pipe that
no one reads holds up that thread alone, and what does not fit in its queue is dropped.

However fast a node changes, the lines stay few: a state has at most STATE_LINES at once and one
every STATE_NS after that, a count one every COUNT_NS.
"""

import os
import shutil
import threading
from collections.abc import Callable, Iterator
from queue import SimpleQueue
from typing import TextIO

from ..node import NS_PER_MS, NS_PER_S, View

LOOK_NS = 50 * NS_PER_MS
STATUS_NS = NS_PER_S
STATE_LINES = 4
STATE_NS = 2 * NS_PER_S
COUNT_NS = 5 * NS_PER_S
QUEUED_MAX = 200
_END_S = 0.5
"""How long the end of a run waits for what is not written yet."""
_CLEAR_LINE = "\r\x1b[K"


class Screen:
    """Writes to ``stream`` from a thread, from ``start`` to ``close``.

    ``dropped``  lines that were not written, because those before them could not be
    """

    def __init__(self, name: str, stream: TextIO) -> None:
        self.has_status = stream.isatty() and os.environ.get("TERM") != "dumb"
        self.dropped = 0
        self._name = name
        self._write = _writer(stream)
        self._status = ""
        self._queue: SimpleQueue[bytes] = SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="screen", daemon=True)

    def start(self) -> None:
        """Begin to write.

        The thread inherits its starter's priority: at a lower one it could keep the interpreter
        from the loop, as it holds the interpreter's lock for moments.
        """
        self._thread.start()

    def line(self, text: str) -> None:
        """Print one line, above the status line."""
        line = f"{self._name}: {text}\n"
        self._put(f"{_CLEAR_LINE}{line}{self._status}" if self.has_status else line)

    def status(self, text: str) -> None:
        """Rewrite the status line in place."""
        self._status = text[: shutil.get_terminal_size().columns - 1]
        self._put(f"{_CLEAR_LINE}{self._status}")

    def close(self) -> None:
        """Remove the status line, and end the thread if what it writes to lets it."""
        if self._status:
            self._put(_CLEAR_LINE)
        if self.dropped:
            self._put(f"{self._name}: {self.dropped} lines not shown: they could not be written\n")
        self._queue.put(b"")
        self._thread.join(_END_S)

    def _put(self, text: str) -> None:
        if self._queue.qsize() >= QUEUED_MAX:
            self.dropped += 1
        else:
            self._queue.put(text.encode("utf-8", "backslashreplace"))

    def _run(self) -> None:
        while waiting := self._queue.get():
            try:
                self._write(waiting)
            except OSError:  # no one reads any more, or the disk is full
                self.dropped += 1


class Changes:
    """Compares each view with those before, and remembers what was printed."""

    def __init__(self) -> None:
        self._states: dict[str, str] = {}
        self._counts: dict[str, int] = {}
        self._free_ns: dict[str, int] = {}

    def lines(self, view: View, now_ns: int) -> Iterator[str]:
        """Return a line for each state and count that differs from what was printed of it."""
        for name, text in view.states.items():
            if text != self._states.get(name, "") and self._may(
                name, now_ns, STATE_NS, STATE_LINES
            ):
                self._states[name] = text
                if text:
                    yield text
        for name, count in view.counts.items():
            rise = count - self._counts.get(name, 0)
            if rise and self._may(name, now_ns, COUNT_NS, 1):
                self._counts[name] = count
                yield f"{name}: {rise}" if rise == count else f"{name}: {rise} more, {count} so far"

    def _may(self, name: str, now_ns: int, every_ns: int, at_once: int) -> bool:
        """Whether a line about ``name`` is due: ``at_once`` of them, then one each ``every_ns``."""
        free_ns = max(self._free_ns.get(name, now_ns), now_ns)
        if free_ns - now_ns > (at_once - 1) * every_ns:
            return False
        self._free_ns[name] = free_ns + every_ns
        return True


class Observer:
    """Looks at a node every LOOK_NS and prints what is new, with the time since ``start_ns``."""

    def __init__(self, look: Callable[[int], View], screen: Screen, start_ns: int) -> None:
        self._look = look
        self._screen = screen
        self._start_ns = start_ns
        self._changes = Changes()
        self._next_ns = self._status_ns = start_ns

    def __call__(self, now_ns: int) -> None:
        """Look, if it is time."""
        if now_ns < self._next_ns:
            return
        self._next_ns = now_ns + LOOK_NS
        since_s = (now_ns - self._start_ns) / NS_PER_S
        view = self._look(now_ns)
        for line in self._changes.lines(view, now_ns):
            self._screen.line(f"{since_s:.2f} s: {line}")
        if self._screen.has_status and now_ns >= self._status_ns:
            self._status_ns = now_ns + STATUS_NS
            self._screen.status(f"{since_s:.0f} s  {view.now}")


def _writer(stream: TextIO) -> Callable[[bytes], object]:
    """Return what writes to ``stream`` past its buffer, whose lock a blocked thread would keep."""
    try:
        descriptor = stream.fileno()
    except OSError:  # a stream in memory, which never blocks
        return lambda text: stream.write(text.decode())
    return lambda text: _write_all(descriptor, text)


def _write_all(descriptor: int, text: bytes) -> None:
    while text:
        text = text[os.write(descriptor, text) :]
