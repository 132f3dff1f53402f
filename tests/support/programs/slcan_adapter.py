"""Emulated slcan adapters on pseudo-terminals, with a CAN bus between them.

An adapter speaks the Lawicel protocol: ``S6`` sets the bit rate, ``O`` opens, ``L`` only listens,
``C`` closes, ``t1232AABB`` is a frame with an 11-bit identifier (``T`` 29 bits, ``r`` and ``R``
remote), each ended by a carriage return. What one open adapter is given the others hand out.
"""

import os
import select
import threading
import tty
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

from steer_by_wire.runtime.frame import EXTENDED, REMOTE, Frame

FRAME_STARTS = b"tTrR"


class Adapter:
    """One adapter.

    ``path``      where programs find it: a link that changes with every plugging in
    ``commands``  the commands that it received, without the frames
    ``frames``    what it was given to send
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.commands: list[str] = []
        self.frames: list[Frame] = []
        self.is_open = self.may_send = False
        self._ends: tuple[int, int] | None = None
        self._partial = b""

    def plug_in(self) -> None:
        """Make the terminal."""
        self._ends = os.openpty()
        for end in self._ends:
            tty.setraw(end)
        os.set_blocking(self._ends[0], False)
        self.path.unlink(missing_ok=True)
        self.path.symlink_to(os.ttyname(self._ends[1]))
        self._partial, self.is_open, self.may_send = b"", False, False

    def unplug(self) -> None:
        """Take the terminal away, also from who has it open."""
        ends, self._ends = self._ends, None
        self.is_open = self.may_send = False
        self.path.unlink(missing_ok=True)
        for end in ends or ():
            os.close(end)

    @property
    def descriptor(self) -> int | None:
        """The adapter's end of the terminal."""
        return self._ends[0] if self._ends else None

    def say(self, line: bytes) -> None:
        """Write to the program; what it does not read in time is lost, as in an adapter."""
        if self._ends is not None:
            with suppress(BlockingIOError):
                os.write(self._ends[0], line + b"\r")

    def listen(self) -> list[bytes]:
        """Read what the program has written, and obey; returns the frames to pass on."""
        if self._ends is None:
            return []
        *lines, self._partial = (self._partial + os.read(self._ends[0], 4096)).split(b"\r")
        passed_on = []
        for line in filter(None, lines):
            if line[:1] in FRAME_STARTS:
                if self.may_send:
                    self.frames.append(frame_of_line(line))
                    passed_on.append(line)
            else:
                self.commands.append(line.decode())
                if line[:1] in b"OLC":
                    self.is_open, self.may_send = line[:1] in b"OL", line[:1] == b"O"
                self.say(b"")
        return passed_on


class AdapterBus:
    """Adapters on one bus, at work until the end of the block."""

    def __init__(self, paths: Sequence[Path]) -> None:
        self.adapters = [Adapter(path) for path in paths]
        self._lock = threading.Lock()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="adapters")

    def __enter__(self) -> Self:
        for adapter in self.adapters:
            adapter.plug_in()
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stop.set()
        self._thread.join()
        for adapter in self.adapters:
            adapter.unplug()

    def unplug(self, index: int) -> None:
        """Take one adapter off the computer."""
        with self._lock:
            self.adapters[index].unplug()

    def plug_in(self, index: int) -> None:
        """Put it back."""
        with self._lock:
            self.adapters[index].plug_in()

    def say(self, index: int, line: bytes) -> None:
        """Have one adapter send something to its program."""
        with self._lock:
            self.adapters[index].say(line)

    def _run(self) -> None:
        while not self._stop.is_set():
            descriptors = {
                adapter.descriptor: adapter
                for adapter in self.adapters
                if adapter.descriptor is not None
            }
            try:
                ready = select.select(list(descriptors), [], [], 0.01)[0]
            except OSError:
                continue  # unplugged meanwhile
            with self._lock:
                for descriptor in ready:
                    adapter = descriptors[descriptor]
                    if adapter.descriptor == descriptor:
                        self._pass_on(adapter)

    def _pass_on(self, sender: Adapter) -> None:
        try:
            lines = sender.listen()
        except OSError:
            return  # nobody has it open
        for line in lines:
            for adapter in self.adapters:
                if adapter is not sender and adapter.is_open:
                    adapter.say(line)


def frame_of_line(line: bytes) -> Frame:
    """Return the frame that a line of the protocol stands for."""
    start = line[:1]
    digits = 8 if start in b"TR" else 3
    flags = (EXTENDED if start in b"TR" else 0) | (REMOTE if start in b"rR" else 0)
    length = 0 if start in b"rR" else int(line[1 + digits : 2 + digits])
    data = bytes.fromhex(line[2 + digits : 2 + digits + 2 * length].decode())
    return Frame(int(line[1 : 1 + digits], 16), data, flags)
