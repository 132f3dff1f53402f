"""One lane: a thread that listens to one bus, and what a page is sent of it.

The thread alone touches the sampler. It leaves its results in places that are replaced as a whole,
so that the server reads them without a lock; what the server wants done it queues for the thread.
"""

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path as FilePath
from queue import Empty, SimpleQueue
from typing import Any

from ...closed_loop.recordings.live_reading import LATE_NS, LiveReader
from ...dbc.listening import OUR_MESSAGES, Listening
from ...plant_emulator.path.path import Path
from ...runtime.exit_status import BusError, cause_of
from ...runtime.frame import Frame
from ...runtime.node import NS_PER_S
from ...runtime.port.python_can import ClosablePort
from ...runtime.recording.candump import CandumpLog
from .ghost import Ghost
from .sampler import Sampler
from .signals import ROW_PERIOD_S, packed_row

ROWS_KEPT = 1500
"""Rows that a page which comes late, or falls behind, can still get: half a minute."""
_ROW_PERIOD_NS = round(ROW_PERIOD_S * NS_PER_S)
_NOTHING_YET: Mapping[str, Any] = {
    "lights": [], "frames": {}, "law": "", "lost": False, "failure": "",
}  # fmt: skip
_STATUS_NS = NS_PER_S // 4
_ROWS_BEHIND_MAX = 25
"""After a longer pause of this program the rows in between are left out."""


class Lane:
    """Listens on a port until ``close``, which also closes the port."""

    def __init__(
        self,
        port: ClosablePort,
        start_ns: int,
        path: Path | None = None,
        ghost: Ghost | None = None,
        listening: Listening = OUR_MESSAGES,
    ) -> None:
        self._port = port
        self._reader = LiveReader(port)
        self._sampler = Sampler(start_ns, path, ghost, listening)
        self._row_ns = self._status_ns = time.monotonic_ns()
        self._rows: list[bytes] = [b""] * ROWS_KEPT
        self.row_count = 0
        self.status: Mapping[str, Any] = _NOTHING_YET
        self._failure = ""
        self._wishes: SimpleQueue[Callable[[], None]] = SimpleQueue()
        self._log: CandumpLog | None = None
        self._is_closing = False
        self._thread = threading.Thread(target=self._run, name="lane", daemon=True)
        self._thread.start()

    def rows_since(self, index: int) -> tuple[int, Sequence[bytes]]:
        """Return the rows from ``index`` on that are still kept, and the index after them."""
        end = self.row_count
        # The oldest few may be overwritten while they are read.
        first = max(index, end - ROWS_KEPT + _ROWS_BEHIND_MAX, 0)
        return end, [self._rows[number % ROWS_KEPT] for number in range(first, end)]

    def send(self, frames: Sequence[Frame]) -> None:
        """Send frames on the bus, and take them as heard: a bus returns no own frames."""
        self._wishes.put(lambda: self._send(frames))

    def reset_figures(self) -> None:
        """Let the running figures start again."""
        self._wishes.put(self._sampler.reset_figures)

    def on_plant_start(self) -> None:
        """Take note that the plant was started."""
        self._wishes.put(self._sampler.on_plant_start)

    def record(self, file: FilePath | None) -> None:
        """Write every frame into ``file`` from now on, as candump does; None ends that."""
        done = threading.Event()
        self._wishes.put(lambda: self._record(file, done))
        done.wait(1.0)

    @property
    def is_recording(self) -> bool:
        """Whether it writes a recording."""
        return self._log is not None

    def close(self) -> None:
        """End the thread and close the port."""
        self._is_closing = True
        self._thread.join()

    def _run(self) -> None:
        try:
            while not self._is_closing:
                self._turn()
        except BusError as error:
            self.status = {**self.status, "failure": str(error)}
        finally:
            self._record(None, threading.Event())
            with suppress(BusError, OSError):
                self._port.shutdown()

    def _turn(self) -> None:
        read = self._reader.next(self._row_ns)
        now_ns = time.monotonic_ns()
        if read is not None:
            if read.late_ns > LATE_NS:
                self._sampler.on_late_read(read.late_ns, now_ns)
            self._take(read.frame, read.time_ns, has_time=read.has_time)
        with suppress(Empty):
            while True:
                self._wishes.get_nowait()()
        self._leave_rows(now_ns)

    def _take(self, frame: Frame, now_ns: int, *, has_time: bool = True) -> None:
        self._sampler.on_frame(frame, now_ns, has_time=has_time)
        if self._log is not None:
            try:
                self._log.write(time.time_ns(), frame)
            except OSError as error:
                self._end_log(error)

    def _leave_rows(self, now_ns: int) -> None:
        if now_ns - self._row_ns > _ROWS_BEHIND_MAX * _ROW_PERIOD_NS:
            self._row_ns = now_ns
        while self._row_ns <= now_ns:
            values = self._sampler.row(self._row_ns)
            row = packed_row((self._row_ns - self._sampler.start_ns) / NS_PER_S, values)
            self._rows[self.row_count % ROWS_KEPT] = row
            self.row_count += 1
            self._row_ns += _ROW_PERIOD_NS
        if now_ns >= self._status_ns:
            self._status_ns = now_ns + _STATUS_NS
            self.status = {
                "lights": [light._asdict() for light in self._sampler.lights(now_ns)],
                "frames": self._sampler.frames(now_ns),
                "law": self._sampler.law(now_ns),
                "score": self._sampler.score(),
                "grip": self._sampler.grip_text(now_ns),
                "hand_wheel": self._sampler.hand_wheel_text(),
                "lost": self._sampler.is_lost,
                "failure": self._failure,
            }

    def _send(self, frames: Sequence[Frame]) -> None:
        for frame in frames:
            if self._port.send(frame):
                self._take(frame, time.monotonic_ns())

    def _record(self, file: FilePath | None, done: threading.Event) -> None:
        try:
            if self._log is not None:
                self._log.close()
            self._log = None if file is None else CandumpLog(file, "cockpit")
            self._failure = self._failure if file is None else ""
        except OSError as error:
            self._end_log(error)
        done.set()

    def _end_log(self, error: OSError) -> None:
        """End a recording that cannot be written, as on a full disk; the lane goes on."""
        self._failure = f"the recording has ended: {cause_of(error)}"
        log, self._log = self._log, None
        if log is not None:
            with suppress(OSError):
                log.close()
