"""The transmit buffers of a client: one for each identifier that it sends.

When one is full the client is notified, and itself refuses further frames of that identifier, so
that other frames do not wait behind them. A client that sends more is not read.
"""

from ..frame import EXTENDED, Frame
from .protocol import Buffer

BUFFER_FULL = 16
"""Frames in a transmit buffer at which its client is notified that it is full."""
FRAMES_WAITING_MAX = 64
"""Frames in a transmit buffer at which the broker stops reading from its client. There is room for
frames on their way when the buffer became full, and for a client that waits in ``send``."""
BUFFERS_MAX = 32
"""Waiting identifiers of one client at which the broker stops reading from it."""

_Key = tuple[int, bool]
"""Identifier of the frames, and whether it has 29 bits."""


class TransmitBuffers:
    """Counts the frames of one client that wait for the bus."""

    def __init__(self) -> None:
        self._waiting: dict[_Key, int] = {}
        self._full: set[_Key] = set()

    @property
    def frames_waiting(self) -> int:
        """All frames that wait."""
        return sum(self._waiting.values())

    def has_room(self, frame: Frame) -> bool:
        """Whether one more frame may wait."""
        waiting = self._waiting.get(_key(frame), 0)
        return waiting < FRAMES_WAITING_MAX if waiting else len(self._waiting) < BUFFERS_MAX

    def add(self, frame: Frame, *, can_tell: bool) -> Buffer | None:
        """Count a frame that waits; returns the news for the client that its buffer is full.

        ``can_tell``  whether there may be news; one that does not read them is held back in the end
        """
        key = _key(frame)
        self._waiting[key] = waiting = self._waiting.get(key, 0) + 1
        if waiting < BUFFER_FULL or key in self._full or not can_tell:
            return None
        self._full.add(key)
        return Buffer(*key, has_room=False)

    def remove(self, frame: Frame) -> Buffer | None:
        """Count a frame that has left its buffer; returns the news that there is room again."""
        key = _key(frame)
        waiting = self._waiting.pop(key) - 1
        if waiting:
            self._waiting[key] = waiting
        if waiting >= BUFFER_FULL or key not in self._full:
            return None
        self._full.discard(key)
        return Buffer(*key, has_room=True)


def _key(frame: Frame) -> _Key:
    return frame.can_id, frame.flags & EXTENDED != 0
