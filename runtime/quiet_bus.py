"""A CAN bus on which nothing goes wrong and nobody else sends, for runs in virtual time.

It delivers what a ``BusModel`` without errors, other traffic and FIFOs delivers, by its first three
rules, in a third of the time: the end of a frame is known when it wins the bus. A test compares the
two.
"""

from collections import deque
from collections.abc import Sequence
from heapq import heappop, heappush

from .arbitration import arbitration_field
from .bit_ticks import bit_ticks
from .bus_model import BusOverflowError
from .frame import Frame
from .frame_length import INTERMISSION_BITS, bits_of_eight_bytes, frame_bits
from .node import NEVER_NS


class QuietBus:
    """A bus. ``now_ns`` must never decrease from one call to the next.

    ``bitrate_bit_s``  bit rate [bit/s], also of the data phase of FD frames
    ``queue_limit``    frames of one identifier that a sender may have waiting

    ``next_event_ns``  when the next frame will be complete [ns]; NEVER_NS with nothing on the bus.
                       Until the bus is free this may change with every submission

    Raises ValueError for a rate or a limit that is not positive.
    """

    def __init__(self, bitrate_bit_s: int, queue_limit: int = 1000) -> None:
        if bitrate_bit_s <= 0 or queue_limit <= 0:
            raise ValueError(
                f"bit rate and queue limit must be positive, not {bitrate_bit_s} bit/s and "
                f"{queue_limit}"
            )
        # A time without a unit is in 1/_per_ns of a nanosecond, as in a BusModel.
        self._per_ns, self._bit_ticks, _ = bit_ticks(bitrate_bit_s, bitrate_bit_s)
        self._intermission_ticks = INTERMISSION_BITS * self._bit_ticks
        self._queue_limit = queue_limit
        self._queue: list[tuple[int, int, int, int, Frame]] = []
        """Arbitration field, number, duration, sender and frame of those that wait."""
        self._won: deque[tuple[int, int, Frame]] = deque()
        """End [ns], sender and frame of those that have won the bus."""
        self._free_ticks = self._submitted = 0
        self.next_event_ns = NEVER_NS

    def submit(self, frame: Frame, sender: int, now_ns: int) -> None:
        """Queue ``frame`` of ``sender``, ready to compete from ``now_ns`` on.

        Raises ValueError for a frame that cannot be sent, BusOverflowError for a full buffer.
        """
        can_id, data, flags = frame
        if not flags and len(data) == 8 and 0 <= can_id <= 0x7FF:
            bits, arbitration = bits_of_eight_bytes(can_id, data), can_id << 21
        else:
            bits, arbitration = sum(frame_bits(frame)), arbitration_field(frame)
        now_ticks, queue = now_ns * self._per_ns, self._queue
        if self._free_ticks < now_ticks:
            if queue:
                self._arbitrate(now_ticks)
            if not queue and self._free_ticks < now_ticks:
                self._free_ticks = now_ticks
        if len(queue) >= self._queue_limit:
            self._refuse_overflow(frame, sender, arbitration)
        self._submitted = number = self._submitted + 1
        duration_ticks = bits * self._bit_ticks
        heappush(queue, (arbitration, number, duration_ticks, sender, frame))
        if not self._won and queue[0][1] == number:
            self.next_event_ns = -(-(self._free_ticks + duration_ticks) // self._per_ns)

    def advance(self, now_ns: int) -> Sequence[tuple[int, int, Frame]]:
        """Return end [ns], sender and frame of what is complete up to ``now_ns``, in order."""
        now_ticks, won = now_ns * self._per_ns, self._won
        if self._free_ticks < now_ticks:
            self._arbitrate(now_ticks)
        completed = []
        while won and won[0][0] <= now_ns:
            completed.append(won.popleft())
        if won:
            self.next_event_ns = won[0][0]
        elif self._queue:
            self.next_event_ns = -(-(self._free_ticks + self._queue[0][2]) // self._per_ns)
        else:
            self.next_event_ns = NEVER_NS
        return completed

    def _arbitrate(self, now_ticks: int) -> None:
        """Decide all arbitrations before now.

        One at this instant stays open, because a frame submitted at this instant still competes.
        """
        queue, free_ticks = self._queue, self._free_ticks
        while queue and free_ticks < now_ticks:
            _, _, duration_ticks, sender, frame = heappop(queue)
            end_ticks = free_ticks + duration_ticks
            self._won.append((-(-end_ticks // self._per_ns), sender, frame))
            free_ticks = end_ticks + self._intermission_ticks
        self._free_ticks = free_ticks

    def _refuse_overflow(self, frame: Frame, sender: int, arbitration: int) -> None:
        waiting = sum(field == arbitration and by == sender for field, _, _, by, _ in self._queue)
        if waiting >= self._queue_limit:
            raise BusOverflowError(
                f"sender {sender} has {waiting} frames of identifier 0x{frame.can_id:03X} "
                "waiting for the bus"
            )
