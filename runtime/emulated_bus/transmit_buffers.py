"""The transmit buffers of a client: one for each identifier that it sends.

A client whose buffer is full is not read until a frame has left it. Its own further frames wait in
its socket meanwhile, as in the queue of a network interface.
"""

from ..frame import EXTENDED, Frame

FRAMES_WAITING_MAX = 16
"""Frames in a transmit buffer at which the broker stops reading from its client."""
BUFFERS_MAX = 32
"""Waiting identifiers of one client at which the broker stops reading from it."""


class TransmitBuffers:
    """Counts the frames of one client that wait for the bus."""

    def __init__(self) -> None:
        self._waiting: dict[tuple[int, bool], int] = {}
        """By identifier, and whether it has 29 bits."""

    @property
    def frames_waiting(self) -> int:
        """All frames that wait."""
        return sum(self._waiting.values())

    def has_room(self, frame: Frame) -> bool:
        """Whether one more frame may wait."""
        waiting = self._waiting.get(_key(frame), 0)
        return waiting < FRAMES_WAITING_MAX if waiting else len(self._waiting) < BUFFERS_MAX

    def add(self, frame: Frame) -> None:
        """Count a frame that waits."""
        key = _key(frame)
        self._waiting[key] = self._waiting.get(key, 0) + 1

    def remove(self, frame: Frame) -> None:
        """Count a frame that has left its buffer."""
        key = _key(frame)
        if waiting := self._waiting.pop(key) - 1:
            self._waiting[key] = waiting


def _key(frame: Frame) -> tuple[int, bool]:
    return frame.can_id, frame.flags & EXTENDED != 0
