"""A CAN bus without errors and other traffic, for runs in virtual time.

It delivers what a ``BusModel`` without errors, other traffic and FIFOs delivers, by its first three
rules, in a third of the time: the end of a frame is known when it wins the bus. A test compares the
two.
"""

from heapq import heappop, heappush

from ..frame import Frame
from ..frame.arbitration import arbitration_field
from ..frame.length_with_stuff_bits import INTERMISSION_BITS, bits_of_eight_bytes, frame_bits
from ..node import NEVER_NS
from ..node.virtual_time_loop import Delivered
from .bit_ticks import bit_ticks
from .transmit_queue import BusOverflowError

_ON_WIRE = -1
"""Arbitration field of a frame that has won the bus: it stays the first."""


class QuietBus:
    """A bus. ``now_ns`` must never decrease from one call to the next.

    ``bitrate_bit_s``  bit rate [bit/s], also of the data phase of FD frames
    ``queue_limit``    frames of one identifier that a sender may have waiting

    ``next_event_ns``  when the next frame will be complete [ns]; NEVER_NS with nothing on the bus.
                       Until the bus is free this may change with every submission

    Raises ValueError for a rate or a limit that is not positive.
    """

    def __init__(self, bitrate_bit_s: int, queue_limit: int = 1000) -> None:
        if queue_limit <= 0:
            raise ValueError(f"the limit of a transmit buffer must be positive, not {queue_limit}")
        # A time without a unit is in 1/_per_ns of a nanosecond, as in a BusModel.
        self._per_ns, self._bit_ticks, _ = bit_ticks(bitrate_bit_s, bitrate_bit_s)
        self._intermission_ticks = INTERMISSION_BITS * self._bit_ticks
        self._queue_limit = queue_limit
        self._queue: list[tuple[int, int, int, int, Frame]] = []
        """Arbitration field, number, duration, sender and frame of those not complete yet."""
        self._completed: list[Delivered] = []
        """Those that were complete when a later one was submitted."""
        self._free_ticks = self._submitted = 0
        """When the first of the queue starts, or has started; and how many frames there were."""
        self.next_event_ns = NEVER_NS

    def submit(self, frame: Frame, sender: int, now_ns: int) -> None:
        """Queue ``frame`` of ``sender``, ready to compete from ``now_ns`` on.

        Raises ValueError for a frame that cannot be sent, BusOverflowError for a full buffer.
        """
        can_id, data, flags = frame
        if not flags and len(data) == 8:
            bits, arbitration = bits_of_eight_bytes(can_id, data), can_id << 21
        else:
            bits, arbitration = sum(frame_bits(frame)), arbitration_field(frame)
        now_ticks, queue = now_ns * self._per_ns, self._queue
        if self._free_ticks < now_ticks:
            if self.next_event_ns <= now_ns:
                self._completed = self.advance(now_ns)
                self.next_event_ns = self._completed[0][0]
            if queue and self._free_ticks < now_ticks:
                queue[0] = (_ON_WIRE, *queue[0][1:])
            elif self._free_ticks < now_ticks:
                self._free_ticks = now_ticks
        if len(queue) >= self._queue_limit:
            self._refuse_overflow(frame, sender, arbitration)
        self._submitted = number = self._submitted + 1
        entry = arbitration, number, bits * self._bit_ticks, sender, frame
        heappush(queue, entry)
        if queue[0] is entry and not self._completed:
            self.next_event_ns = -(-(self._free_ticks + entry[2]) // self._per_ns)

    def advance(self, now_ns: int) -> list[Delivered]:
        """Return what is complete up to ``now_ns``, in order.

        The next arbitration stays open until a frame submitted later has lost it.
        """
        completed, self._completed = self._completed, []
        queue, per_ns = self._queue, self._per_ns
        while queue:
            end_ticks = self._free_ticks + queue[0][2]
            end_ns = -(-end_ticks // per_ns)
            if end_ns > now_ns:
                self.next_event_ns = end_ns
                return completed
            _, _, _, sender, frame = heappop(queue)
            completed.append((end_ns, sender, frame))
            self._free_ticks = end_ticks + self._intermission_ticks
        self.next_event_ns = NEVER_NS
        return completed

    def _refuse_overflow(self, frame: Frame, sender: int, arbitration: int) -> None:
        waiting = sum(field == arbitration and by == sender for field, _, _, by, _ in self._queue)
        if waiting >= self._queue_limit:
            raise BusOverflowError(
                f"sender {sender} has {waiting} frames of identifier 0x{frame.can_id:03X} "
                "waiting for the bus"
            )
