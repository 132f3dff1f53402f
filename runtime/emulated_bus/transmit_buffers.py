"""The transmit buffers of a channel's clients.

A client has a transmit buffer for each identifier that it sends, like a CAN controller with enough
buffers. When one is full the client is notified, and itself refuses further frames of that
identifier, so that other frames do not wait behind them. A client that sends more is not read.
"""

from ..frame import EXTENDED, Frame
from .broker_connection import BufferKey, Connection
from .protocol import Buffer, pack_buffer

BUFFER_FULL = 16
"""Frames in a transmit buffer at which its client is notified that it is full."""
FRAMES_WAITING_MAX = 64
"""Frames in a transmit buffer at which the broker stops reading from its client. There is room for
frames on their way when the buffer became full, and for a client that waits in ``send``."""
BUFFERS_MAX = 32
"""Waiting identifiers of one client at which the broker stops reading from it."""
_FIFO: BufferKey = (-1, False)
"""The only transmit buffer of a client with a FIFO."""


class TransmitBuffers:
    """Counts the waiting frames of each client; ``is_fifo``: in one buffer, which is never full."""

    def __init__(self, *, is_fifo: bool) -> None:
        self._is_fifo = is_fifo

    def take(self, client: Connection, frame: Frame) -> bool:
        """Count a frame to be sent, if there is room; returns whether there was."""
        buffer, waiting_of = self._buffer(frame), client.waiting
        waiting = waiting_of.get(buffer, 0) + 1
        if waiting > FRAMES_WAITING_MAX or (waiting == 1 and len(waiting_of) >= BUFFERS_MAX):
            return False
        waiting_of[buffer] = waiting
        # A client that does not read misses this, and is held back in the end.
        is_new = waiting >= BUFFER_FULL and buffer not in client.full
        if is_new and not self._is_fifo and not client.is_behind:
            client.full.add(buffer)
            _report(client, buffer, has_room=False)
        return True

    def free(self, client: Connection, frame: Frame) -> None:
        """Count a frame that has left its buffer."""
        buffer = self._buffer(frame)
        waiting = client.waiting.pop(buffer) - 1
        if waiting:
            client.waiting[buffer] = waiting
        if waiting == BUFFER_FULL - 1 and buffer in client.full:
            client.full.discard(buffer)
            _report(client, buffer, has_room=True)

    def empty(self, client: Connection) -> None:
        """Forget all frames of a client."""
        client.waiting.clear()
        for buffer in sorted(client.full):
            _report(client, buffer, has_room=True)
        client.full.clear()

    def _buffer(self, frame: Frame) -> BufferKey:
        return _FIFO if self._is_fifo else (frame.can_id, frame.flags & EXTENDED != 0)


def _report(client: Connection, buffer: BufferKey, *, has_room: bool) -> None:
    client.queue(pack_buffer(client.record, Buffer(*buffer, has_room=has_room)))
