"""A CAN bus: frames occupy the wire for their length, one after the other, by identifier.

Rules:

1. Whenever the bus is free, all waiting frames compete, including those submitted at that instant.
   The lowest arbitration field wins; of equal ones, the first submitted. A sender has a transmit
   buffer for each identifier, so that none of its frames waits behind one of lower priority. With
   a FIFO, as SocketCAN has, only the sender's oldest frame competes.
2. A frame on the wire is never interrupted.
3. A frame is complete at its end of frame, and the next one may start three bits (intermission)
   later. Acknowledgement, errors, retransmission and clock tolerance are not modelled.

Two nodes sending equal arbitration fields at once is an error on a real bus; here they queue.

Times are integer nanoseconds at the interface. Internally they are integer ticks, the largest
fraction of a nanosecond that divides both bit times, so that consecutive frames add up without
rounding. An end is rounded up to the next nanosecond only when it is returned.

The same class serves virtual time and, with readings of the real clock, the emulated bus.
"""

from collections import deque
from collections.abc import Callable
from heapq import heapify, heappop, heappush
from math import gcd, lcm
from typing import NamedTuple

from .frame import EXTENDED, REMOTE, Frame
from .frame_length import INTERMISSION_BITS, frame_bits
from .node import NEVER_NS, NS_PER_S
from .record import new_record


class BusOverflowError(RuntimeError):
    """A sender's transmit buffer is full."""


class Delivery(NamedTuple):
    """A frame that is complete on the wire.

    ``end_ns``  time of its end of frame [ns]
    ``sender``  who submitted it
    """

    end_ns: int
    sender: int
    frame: Frame


class BusLoad(NamedTuple):
    """Totals of the bus.

    ``frames``   complete frames
    ``busy_ns``  time they took, intermissions included [ns]
    ``refused``  frames not taken because their transmit buffer was full
    """

    frames: int
    busy_ns: int
    refused: int


class _Waiting(NamedTuple):
    """A frame in the queue; sorts by arbitration, then by order of submission."""

    arbitration: int
    sequence: int
    duration_ticks: int
    sender: int
    frame: Frame
    submitted_ticks: int
    buffer: tuple[int, int]


def arbitration_field(frame: Frame) -> int:
    """The bits that compete for the bus, as a number of 32 bits; the lower one wins.

    Base identifier (11), RTR or SRR, IDE, identifier extension (18), RTR: an 11-bit identifier wins
    against a 29-bit one with the same base, a data frame against a remote frame of its identifier.
    """
    can_id, _, flags = frame
    if not flags:
        return can_id << 21
    rtr = 1 if flags & REMOTE else 0
    if flags & EXTENDED:
        return can_id >> 18 << 21 | 0b11 << 19 | (can_id & 0x3FFFF) << 1 | rtr
    return can_id << 21 | rtr << 20


class BusModel:
    """A bus. ``now_ns`` must never decrease from one call to the next.

    ``bitrate_bit_s``       nominal bit rate [bit/s]
    ``data_bitrate_bit_s``  bit rate of the data phase of FD frames with BITRATE_SWITCH [bit/s];
                            the nominal one unless given
    ``queue_limit``         frames of one identifier that a sender may have waiting; with
                            ``is_fifo``, of all
    ``on_start``            called as ``on_start(frame, delay_ns)`` when a frame wins the bus, with
                            the time from its submission to its start of frame [ns]
    ``is_fifo``             whether the frames of one sender keep their order

    ``next_event_ns``  when the next frame will be complete [ns]; NEVER_NS with nothing on the bus.
                       Until the bus is free this may change with every submission

    Raises ValueError for a rate or a limit that is not positive.
    """

    def __init__(
        self,
        bitrate_bit_s: int,
        data_bitrate_bit_s: int | None = None,
        queue_limit: int = 1000,
        on_start: Callable[[Frame, int], None] | None = None,
        *,
        is_fifo: bool = False,
    ) -> None:
        data_rate = bitrate_bit_s if data_bitrate_bit_s is None else data_bitrate_bit_s
        if bitrate_bit_s <= 0 or data_rate <= 0 or queue_limit <= 0:
            raise ValueError(
                f"bit rates and queue limit must be positive, not {bitrate_bit_s} bit/s, "
                f"{data_rate} bit/s and {queue_limit}"
            )
        # A time without a unit is in 1/_per_ns of a nanosecond.
        self._ticks_per_ns = lcm(
            bitrate_bit_s // gcd(bitrate_bit_s, NS_PER_S), data_rate // gcd(data_rate, NS_PER_S)
        )
        self._bit_ticks = NS_PER_S * self._ticks_per_ns // bitrate_bit_s
        self._data_bit_ticks = NS_PER_S * self._ticks_per_ns // data_rate
        self._intermission_ticks = INTERMISSION_BITS * self._bit_ticks
        self._queue_limit = queue_limit
        self._on_start = on_start
        self._is_fifo = is_fifo
        self._queue: list[_Waiting] = []
        # By sender and identifier; with FIFOs by sender, without its oldest frame.
        self._waiting_of: dict[tuple[int, int], int] = {}
        self._behind: dict[int, deque[_Waiting]] = {}
        self._sequence = 0
        self._on_wire: _Waiting | None = None
        self._end_ticks = 0
        self._next_start_ticks = 0
        self._completed: list[Delivery] = []
        self._frames = 0
        self._busy_ticks = 0
        self._refused = 0
        self._look_ahead()

    @property
    def load(self) -> BusLoad:
        """Totals so far."""
        return BusLoad(self._frames, self._whole_ns(self._busy_ticks), self._refused)

    def submit(self, frame: Frame, sender: int, now_ns: int) -> None:
        """Queue ``frame`` of ``sender``, ready to compete from ``now_ns`` on.

        Raises ValueError for a frame that cannot be sent, BusOverflowError for a full buffer.
        """
        nominal_bits, data_bits = frame_bits(frame)
        now_ticks = now_ns * self._ticks_per_ns
        if now_ticks > self._decided_until_ticks:
            self._settle(now_ticks)
            self._look_ahead()
        arbitration = arbitration_field(frame)
        buffer = (sender, 0 if self._is_fifo else arbitration)
        waiting = self._waiting_of.get(buffer, 0)
        if waiting >= self._queue_limit:
            self._refused += 1
            of = "" if self._is_fifo else f"of identifier 0x{frame.can_id:03X} "
            raise BusOverflowError(f"sender {sender} has {waiting} frames {of}waiting for the bus")
        self._waiting_of[buffer] = waiting + 1
        if self._next_start_ticks < now_ticks:
            self._next_start_ticks = now_ticks
        self._sequence += 1
        duration_ticks = nominal_bits * self._bit_ticks + data_bits * self._data_bit_ticks
        entry = new_record(
            _Waiting,
            (arbitration, self._sequence, duration_ticks, sender, frame, now_ticks, buffer),
        )
        if waiting and self._is_fifo:
            self._behind.setdefault(sender, deque()).append(entry)
        else:
            heappush(self._queue, entry)
            if self._on_wire is None and self._queue[0] is entry:
                self._look_ahead()

    def withdraw(self, sender: int) -> list[Frame]:
        """Take back every frame of ``sender`` that is not on the wire yet; returns them."""
        kept = [waiting for waiting in self._queue if waiting.sender != sender]
        withdrawn = [waiting.frame for waiting in self._queue if waiting.sender == sender]
        withdrawn += [waiting.frame for waiting in self._behind.pop(sender, ())]
        heapify(kept)
        self._queue = kept
        for buffer in [buffer for buffer in self._waiting_of if buffer[0] == sender]:
            del self._waiting_of[buffer]
        self._look_ahead()
        return withdrawn

    def advance(self, now_ns: int) -> list[Delivery]:
        """Return the frames completed up to ``now_ns`` and not returned before, in order."""
        now_ticks = now_ns * self._ticks_per_ns
        if now_ticks > self._decided_until_ticks:
            self._settle(now_ticks)
        completed, self._completed = self._completed, []
        self._look_ahead()
        return completed

    def _look_ahead(self) -> None:
        """Find the next end of a frame, and the time up to which there is no arbitration."""
        if self._on_wire is not None:
            end_ticks = self._end_ticks
            self._decided_until_ticks = end_ticks - 1
        elif self._queue:
            self._decided_until_ticks = self._next_start_ticks
            end_ticks = self._next_start_ticks + self._queue[0].duration_ticks
        else:
            self._decided_until_ticks = end_ticks = NEVER_NS * self._ticks_per_ns
        if self._completed:
            self.next_event_ns = self._completed[0].end_ns
        else:
            self.next_event_ns = -(-end_ticks // self._ticks_per_ns)

    def _settle(self, now_ticks: int) -> None:
        """Complete frames that have ended by now, and decide all arbitrations before now.

        One at this instant stays open, because a frame submitted at this instant still competes.
        """
        queue, on_wire, end_ticks = self._queue, self._on_wire, self._end_ticks
        while True:
            if on_wire is None:
                if not queue or self._next_start_ticks >= now_ticks:
                    break
                on_wire = heappop(queue)
                end_ticks = self._next_start_ticks + on_wire.duration_ticks
                self._on_arbitration(on_wire)
            if end_ticks > now_ticks:
                break
            _, _, duration_ticks, sender, frame, _, _ = on_wire
            end_ns = -(-end_ticks // self._ticks_per_ns)
            self._completed.append(new_record(Delivery, (end_ns, sender, frame)))
            self._frames += 1
            self._busy_ticks += duration_ticks + self._intermission_ticks
            self._next_start_ticks = end_ticks + self._intermission_ticks
            on_wire = None
        self._on_wire, self._end_ticks = on_wire, end_ticks

    def _on_arbitration(self, winner: _Waiting) -> None:
        """Record that a frame has won the bus."""
        # Removed when zero: senders and identifiers come and go, and memory must not grow.
        still_waiting = self._waiting_of.pop(winner.buffer) - 1
        if still_waiting:
            self._waiting_of[winner.buffer] = still_waiting
            if self._is_fifo:
                self._compete_next(winner.sender)
        if self._on_start is not None:
            delay_ticks = self._next_start_ticks - winner.submitted_ticks
            self._on_start(winner.frame, delay_ticks // self._ticks_per_ns)

    def _compete_next(self, sender: int) -> None:
        """Let the next frame of a sender's FIFO compete."""
        behind = self._behind[sender]
        heappush(self._queue, behind.popleft())
        if not behind:
            del self._behind[sender]

    def _whole_ns(self, ticks: int) -> int:
        """Convert a time from ticks to nanoseconds, rounded up [ns]."""
        return -(-ticks // self._ticks_per_ns)
