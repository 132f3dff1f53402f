"""End of a node's run: after its duration, or with a signal."""

import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from ..command_line import ending_signals
from ..node import NEVER_NS


class StopRequest:
    """Becomes true when the run has to end, and keeps the reason."""

    def __init__(self) -> None:
        self._end_ns = NEVER_NS
        self.reason = ""

    def __call__(self) -> bool:
        """Whether the run is to end."""
        if not self.reason and time.monotonic_ns() >= self._end_ns:
            self.reason = "duration"
        return bool(self.reason)

    def end_at(self, end_ns: int) -> None:
        """Let the run end at ``end_ns`` at the latest."""
        self._end_ns = end_ns

    @contextmanager
    def on_signals(self) -> Iterator[None]:
        """Let a signal that ends programs end the run, within the block.

        Terminals and wrappers may send a signal twice: the second one must not cost the report.
        """
        with ending_signals(self._take_signal):
            yield

    def _take_signal(self, number: int, _frame: FrameType | None) -> None:
        self.reason = self.reason or signal.Signals(number).name
