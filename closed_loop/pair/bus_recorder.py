"""A recorder of a live bus, which says so when its log ends early."""

import time
from pathlib import Path
from typing import Self

import can

from ...runtime.exit_status import cause_of
from .live_bus import Bus

_PAUSE_S = 0.1
"""Without a frame for so long, a recorder has all that was sent."""
_BEHIND_S_MAX = 10.0


class BusRecorder:
    """Records every frame on a bus, in a thread, from the start of a ``with`` block to its end.

    At the end it still takes what was sent before: a busy machine may be seconds behind.

    ``failure``  why the log ends early, empty if it does not: a bus drops a recorder that reads too
                 slowly, and a disk may be full
    """

    def __init__(self, bus: Bus, candump_log: Path) -> None:
        """Record into ``candump_log``, as ``candump -L`` prints it."""
        self._bus, self._candump_log = bus, candump_log
        self.failure = ""

    def __enter__(self) -> Self:
        self._listener = self._bus.open()
        self._writer = can.CanutilsLogWriter(self._candump_log, channel=self._bus.channel)
        self._notifier = can.Notifier([], [self], timeout=_PAUSE_S)
        self._notifier.add_bus(self._listener)  # its thread may fail at once
        return self

    def __exit__(self, *_: object) -> None:
        end_s = time.time()
        self._notifier.stop()
        try:
            self._record_waiting(end_s)
        except (OSError, can.CanError) as error:
            self.failure = self.failure or cause_of(error)
        try:
            self._writer.stop()
        except OSError as error:
            self.failure = self.failure or cause_of(error)
        self._listener.shutdown()

    def _record_waiting(self, end_s: float) -> None:
        """Write the frames that were sent before a time of the wall clock [s]."""
        until_s = time.monotonic() + _BEHIND_S_MAX
        while not self.failure and (message := self._listener.recv(_PAUSE_S)) is not None:
            if message.timestamp > end_s:  # other people's traffic goes on
                return
            if time.monotonic() > until_s:
                self.failure = f"was still behind {_BEHIND_S_MAX:g} s after its end"
            self._writer(message)

    def __call__(self, message: can.Message) -> None:
        """Write a frame."""
        self._writer(message)

    def on_error(self, error: Exception) -> None:
        """End the recording, and nothing else."""
        self.failure = cause_of(error)
        self._notifier.stop(0.0)
