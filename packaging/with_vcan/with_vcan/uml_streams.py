"""The wrapper's side of a User Mode Linux's serial lines.

Two lines, which are pipes on this side, carry the frames of ``frames``. Standard input has a line
of its own, so that it cannot delay a signal on the other.
"""

import fcntl
import os
import select
import selectors
import signal
import termios
import tty
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial

from .guard import Guard
from .request import BackendError
from .serial_frames import Kind, LineFrame, Unpacker, pack
from .system_calls import Signal

PIECE_BYTES = 2048
"""Standard input per frame, at most: a pipe with room takes at least so much at once."""


def has_terminal() -> bool:
    """Whether we run at a terminal; then the command gets one too."""
    return os.isatty(0) and os.isatty(1)


@contextmanager
def raw_terminal() -> Iterator[None]:
    """Leave echo, Ctrl-C and the like to the guest's terminal during the block."""
    if not has_terminal():
        yield
        return
    before = termios.tcgetattr(0)
    tty.setraw(0)
    try:
        yield
    finally:
        termios.tcsetattr(0, termios.TCSADRAIN, before)


class Streams:
    """Forwards streams and signals, and keeps the command's exit status.

    ``selector``  watches the readable descriptors; its data are the functions to call
    """

    def __init__(self, guard: Guard, from_guest: int, to_guest: int, to_stdin: int) -> None:
        self._guard = guard
        self._from_guest, self._to_guest, self._to_stdin = from_guest, to_guest, to_stdin
        self._unpacker = Unpacker()
        self._waiting: deque[LineFrame] = deque()
        self._ready = False
        self._failure = self._given_up = ""
        self._status: int | None = None
        self._interrupted = 0
        self.selector = selectors.DefaultSelector()
        self.selector.register(from_guest, selectors.EVENT_READ, self._read)

    def pass_on(self, arrived: Signal) -> None:
        """Send a signal to the command; before the command has started, a signal ends the run."""
        if arrived.number == signal.SIGWINCH:
            self._send_size()
        elif self._ready:
            self._write(self._to_guest, pack(Kind.SIGNAL, b"%d" % arrived.number))
        else:
            self._interrupted = arrived.number
            self._guard.end()

    def give_up(self, after_s: float) -> None:
        """End a kernel that has not booted by now; ``after_s`` is for the message."""
        if not self._ready:
            self._given_up = f" within {after_s:g} s"
            self._guard.end()

    def finish(self, kernel_status: int, last_words: str) -> int:
        """Return the command's exit status; raises BackendError when there was no command.

        ``last_words``  of the kernel
        """
        self._work_off(patiently=True)
        while self._from_guest in self.selector.get_map():
            self._read()
        if self._status is not None:
            return self._status
        if self._interrupted:
            return 128 + self._interrupted
        if self._failure:
            raise BackendError(f"User Mode Linux: {self._failure}")
        when = "ended while the command ran" if self._ready else f"has not booted{self._given_up}"
        raise BackendError(
            f"User Mode Linux {when} (status {kernel_status}); "
            f"its last words: {last_words or 'none'}"
        )

    def _read(self) -> None:
        piece = os.read(self._from_guest, 65536)
        if not piece:
            self.selector.unregister(self._from_guest)
            return
        self._waiting.extend(self._unpacker.feed(piece))
        self._work_off()

    def _work_off(self, patiently: bool = False) -> None:
        """Handle the frames that have come, until a reader of our output stops reading.

        Then the guest is not read either, so that it stops too; signals and the time limit still
        work.

        ``patiently``  wait for the reader instead
        """
        while self._waiting:
            frame = self._waiting.popleft()
            if frame.kind not in (Kind.STDOUT, Kind.STDERR):
                self._take(frame)
            elif rest := self._print(frame.kind, frame.content, patiently):
                self._waiting.appendleft(frame._replace(content=rest))
                if self._from_guest in self.selector.get_map():
                    self.selector.unregister(self._from_guest)
                self.selector.register(
                    frame.kind, selectors.EVENT_WRITE, partial(self._print_on, frame.kind)
                )
                return

    def _print_on(self, stream: int) -> None:
        self.selector.unregister(stream)
        self.selector.register(self._from_guest, selectors.EVENT_READ, self._read)
        self._work_off()

    def _take(self, frame: LineFrame) -> None:
        if frame.kind is Kind.READY:
            self._ready = True
            self._send_size()
            self._watch_stdin()
        elif frame.kind is Kind.STATUS:
            self._status = int(frame.content)
            self._guard.end()  # nothing is lost: the guest has synchronised its files
        elif frame.kind is Kind.FAILED:
            self._failure = frame.content.decode(errors="replace")
            self._guard.end()

    def _print(self, stream: int, content: bytes, patiently: bool) -> bytes:
        """Print as much as is accepted at once, or all of it; returns the rest."""
        try:
            while content and (patiently or select.select([], [stream], [], 0.0)[1]):
                # A pipe that has room takes this much.
                content = content[os.write(stream, content[: select.PIPE_BUF]) :]
        except OSError:
            # The reader has gone: close the command's stream, as if it had written there itself.
            self._write(self._to_guest, pack(Kind.CLOSED, b"%d" % stream))
            return b""
        return content

    def _send_size(self) -> None:
        if self._ready and has_terminal():
            size = fcntl.ioctl(0, termios.TIOCGWINSZ, bytes(8))
            self._write(self._to_guest, pack(Kind.SIZE, size))

    def _watch_stdin(self) -> None:
        """Read when the line has free space: a pipe that has room takes a whole piece."""
        self.selector.register(self._to_stdin, selectors.EVENT_WRITE, self._await_stdin)

    def _await_stdin(self) -> None:
        self.selector.unregister(self._to_stdin)
        try:
            self.selector.register(0, selectors.EVENT_READ, self._pass_stdin)
        except (PermissionError, OSError, ValueError):
            # A file or /dev/null is always readable and cannot be watched; closed, it has ended.
            self._pass_stdin(watched=False)

    def _pass_stdin(self, watched: bool = True) -> None:
        if watched:
            self.selector.unregister(0)
        try:
            piece = os.read(0, PIECE_BYTES)
        except OSError:
            piece = b""
        self._write(self._to_stdin, pack(Kind.STDIN, piece))
        if piece:
            self._watch_stdin()

    def _write(self, descriptor: int, content: bytes) -> None:
        with suppress(BrokenPipeError):
            os.write(descriptor, content)
