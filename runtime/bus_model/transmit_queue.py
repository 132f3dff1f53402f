"""The frames that wait for a bus, in the transmit buffers of their senders.

A sender has a buffer for each identifier, so that none of its frames waits behind one of lower
priority.
"""

from heapq import heapify, heappop, heappush
from typing import NamedTuple

from ..frame import Frame


class BusOverflowError(RuntimeError):
    """A sender's transmit buffer is full."""


class Waiting(NamedTuple):
    """A frame in the queue; sorts by arbitration, then by order of submission."""

    arbitration: int
    sequence: int
    duration_ticks: int
    sender: int
    frame: Frame
    buffer: tuple[int, int]


class TransmitQueue:
    """All buffers of one bus; ``limit`` is the size of each, that of the rest bus have one frame.

    ``competing``  a heap of the frames that compete for the bus
    ``refused``    frames that found their buffer full
    """

    def __init__(self, limit: int) -> None:
        if limit <= 0:
            raise ValueError(f"the limit of a transmit buffer must be positive, not {limit}")
        self._limit = limit
        self.competing: list[Waiting] = []
        self._sequence = self.refused = 0
        self._waiting_of: dict[tuple[int, int], int] = {}

    def push(self, arbitration: int, duration_ticks: int, sender: int, frame: Frame) -> Waiting:
        """Queue a frame; raises BusOverflowError for a full buffer."""
        buffer = (sender, arbitration)
        waiting = self._waiting_of.get(buffer, 0)
        if waiting >= (self._limit if sender >= 0 else 1):
            self.refused += 1
            raise BusOverflowError(
                f"sender {sender} has {waiting} frames of identifier 0x{frame.can_id:03X} "
                "waiting for the bus"
            )
        self._waiting_of[buffer] = waiting + 1
        self._sequence += 1
        entry = Waiting(arbitration, self._sequence, duration_ticks, sender, frame, buffer)
        heappush(self.competing, entry)
        return entry

    def remove(self, winner: Waiting) -> None:
        """Remove the frame that has won the bus."""
        heappop(self.competing)
        # Removed when zero: senders and identifiers come and go, and memory must not grow.
        still_waiting = self._waiting_of.pop(winner.buffer) - 1
        if still_waiting:
            self._waiting_of[winner.buffer] = still_waiting

    def put_back(self, sent: Waiting) -> None:
        """Put a destroyed frame back into its buffer, in front."""
        self._waiting_of[sent.buffer] = self._waiting_of.get(sent.buffer, 0) + 1
        heappush(self.competing, sent)

    def withdraw(self, sender: int) -> int:
        """Take back every frame of ``sender``; returns how many."""
        before = len(self.competing)
        self.competing[:] = [one for one in self.competing if one.sender != sender]
        heapify(self.competing)
        for buffer in [buffer for buffer in self._waiting_of if buffer[0] == sender]:
            del self._waiting_of[buffer]
        return before - len(self.competing)
