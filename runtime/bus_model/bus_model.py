"""A CAN bus: frames occupy the wire for their length, one after the other, by identifier.

Rules:

1. Whenever the bus is free, all waiting frames compete, including those submitted at that instant.
   The lowest arbitration field wins; of equal ones, the first submitted. ``transmit_queue`` says
   which frames of a sender compete.
2. A frame on the wire is never interrupted.
3. A frame is complete at its end of frame, and the next one may start three bits (intermission)
   later. Someone always acknowledges; clock tolerance is not modelled.
4. With ``errors``, a frame that noise destroys ends with BIT_ERROR (``bus_errors``) and
   competes again, first in its transmit buffer. Bus-off takes the frames of its sender off the
   bus until it has recovered.

Two nodes sending equal arbitration fields at once is an error on a real bus; here they queue.

Times are integer nanoseconds at the interface, and ticks (``bit_ticks``) inside. An end is rounded
up to the next nanosecond only when it is returned.

It serves the emulated bus in real time, and virtual time where ``quiet_bus`` is not enough.
"""

from typing import NamedTuple

from ..frame import Frame
from ..frame.arbitration import arbitration_field
from ..frame.length_with_stuff_bits import INTERMISSION_BITS, frame_bits
from ..node import NEVER_NS
from .bit_ticks import bit_ticks
from .bus_errors import BusErrors, error_end_ticks
from .rest_bus import RestBus
from .socketcan_error_frames import BIT_ERROR
from .transmit_queue import BusOverflowError, TransmitQueue, Waiting

NO_NODE = -1
"""Sender of an error frame, which every controller sends."""


class Delivery(NamedTuple):
    """A frame that is complete on the wire.

    ``end_ns``  time of its end of frame [ns]
    ``sender``  who submitted it; negative for the traffic, and for an error frame
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


class BusModel:
    """A bus. ``now_ns`` must never decrease from one call to the next.

    ``bitrate_bit_s``       nominal bit rate [bit/s]
    ``data_bitrate_bit_s``  that of FD frames' data phase with BITRATE_SWITCH; the same unless given
    ``queue_limit``         size of each transmit buffer [frames]
    ``errors``              noise and error counters; without them every frame is sent whole
    ``traffic``             what else is sent, by nodes of negative numbers

    ``next_event_ns``  when the next frame will be complete [ns]; NEVER_NS with no submitted frame
                       on the bus: no one waits for the traffic. Until the bus is free this may
                       change with every submission. With ``traffic`` it is a lower bound

    Raises ValueError for a rate or a limit that is not positive.
    """

    def __init__(
        self,
        bitrate_bit_s: int,
        data_bitrate_bit_s: int | None = None,
        queue_limit: int = 1000,
        *,
        errors: BusErrors | None = None,
        traffic: RestBus | None = None,
    ) -> None:
        data_rate = bitrate_bit_s if data_bitrate_bit_s is None else data_bitrate_bit_s
        ticks = self._ticks = bit_ticks(bitrate_bit_s, data_rate)
        self._ticks_per_ns, self._bit_ticks, self._data_bit_ticks = ticks
        self._intermission_ticks = INTERMISSION_BITS * self._bit_ticks
        self._queue = TransmitQueue(queue_limit)
        self._errors, self._traffic = errors, traffic
        if traffic is not None:
            traffic.join(ticks)
        self._is_destroyed = False
        self._on_wire: Waiting | None = None
        self._end_ticks = self._next_start_ticks = 0
        self._settled_ticks, self._completed = -1, list[Delivery]()
        self._frames = self._busy_ticks = self.lost_in_bus_off = 0
        self._awaited = 0
        """Frames that were submitted and are not complete."""
        self._look_ahead()

    @property
    def load(self) -> BusLoad:
        """Totals so far."""
        return BusLoad(self._frames, self._ticks.whole_ns(self._busy_ticks), self._queue.refused)

    @property
    def load_until_ns(self) -> int:
        """Time that the totals cover, up to the last instant asked for or intermission."""
        return self._ticks.whole_ns(max(self._settled_ticks, self._next_start_ticks))

    def submit(self, frame: Frame, sender: int, now_ns: int) -> None:
        """Queue ``frame`` of ``sender``, ready to compete from ``now_ns`` on.

        Raises ValueError for a frame that cannot be sent, BusOverflowError for a full buffer.
        """
        nominal_bits, data_bits = frame_bits(frame)
        now_ticks = now_ns * self._ticks_per_ns
        if now_ticks > self._decided_until_ticks:
            self._settle(now_ticks)
            self._look_ahead()
        if self._errors is not None and self._errors.is_off(sender, now_ticks):
            self.lost_in_bus_off += 1
            return
        duration_ticks = nominal_bits * self._bit_ticks + data_bits * self._data_bit_ticks
        queue, arbitration = self._queue, arbitration_field(frame)
        entry = queue.push(arbitration, duration_ticks, sender, frame)
        self._awaited += 1
        if self._on_wire is None and self._next_start_ticks < now_ticks:
            self._next_start_ticks = now_ticks
        is_next = self._on_wire is None and queue.competing[0] is entry
        if is_next or self.next_event_ns == NEVER_NS:
            self._look_ahead()

    def is_off(self, sender: int, now_ns: int) -> bool:
        """Whether a sender is in bus-off; lets it take part again when that is over."""
        return self._errors is not None and self._errors.is_off(sender, now_ns * self._ticks_per_ns)

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
        elif competing := self._queue.competing:
            self._decided_until_ticks = self._next_start_ticks
            end_ticks = self._next_start_ticks + competing[0].duration_ticks
        else:
            self._decided_until_ticks = end_ticks = NEVER_NS * self._ticks_per_ns
        if self._traffic is not None:
            if self._on_wire is None:
                self._decided_until_ticks = self._settled_ticks
            if not self._awaited:
                end_ticks = NEVER_NS * self._ticks_per_ns
        if self._completed:
            self.next_event_ns = self._completed[0].end_ns
        else:
            self.next_event_ns = -(-end_ticks // self._ticks_per_ns)

    def _settle(self, now_ticks: int) -> None:
        """Let the traffic release its frames before now, and the bus carry what competes."""
        if (traffic := self._traffic) is not None:
            while (due_ticks := traffic.next_due_ns * self._ticks_per_ns) < now_ticks:
                self._carry(due_ticks)
                self._take_release(traffic, due_ticks)
        self._carry(now_ticks)

    def _take_release(self, traffic: RestBus, due_ticks: int) -> None:
        """Let the next message of the traffic compete, if its buffer is free."""
        if self._on_wire is None and self._next_start_ticks < due_ticks:
            self._next_start_ticks = due_ticks
        arbitration, duration_ticks, sender, frame = traffic.ready
        counts_on = True
        if self._errors is None or not self._errors.is_off(sender, due_ticks):
            try:
                self._queue.push(arbitration, duration_ticks, sender, frame)
            except BusOverflowError:
                counts_on = False
        traffic.release(counts_on=counts_on)

    def _carry(self, now_ticks: int) -> None:
        """Complete frames that have ended by now, and decide all arbitrations before now.

        One at this instant stays open, because a frame submitted at this instant still competes.
        """
        competing, on_wire, end_ticks = self._queue.competing, self._on_wire, self._end_ticks
        errors = self._errors
        while True:
            if on_wire is None:
                if not competing or self._next_start_ticks >= now_ticks:
                    break
                start_ticks, on_wire = self._next_start_ticks, competing[0]
                end_ticks = start_ticks + on_wire.duration_ticks
                self._queue.remove(on_wire)
                if errors is not None:
                    hit_ns = errors.next_hit_ns(-(-start_ticks // self._ticks_per_ns))
                    hit_ticks = hit_ns * self._ticks_per_ns
                    self._is_destroyed = hit_ticks < end_ticks
                    if self._is_destroyed:
                        end_ticks = error_end_ticks(start_ticks, hit_ticks, self._ticks)
            if end_ticks > now_ticks:
                break
            if errors is not None and self._is_destroyed:
                self._end_attempt(on_wire, end_ticks, errors)
            else:
                if errors is not None:
                    errors.on_whole(on_wire.sender)
                self._complete(on_wire, end_ticks)
            on_wire = None
        self._on_wire, self._end_ticks, self._settled_ticks = on_wire, end_ticks, now_ticks

    def _complete(self, sent: Waiting, end_ticks: int) -> None:
        end_ns = -(-end_ticks // self._ticks_per_ns)
        self._completed.append(Delivery(end_ns, sent.sender, sent.frame))
        self._awaited -= sent.sender >= 0
        self._frames += 1
        self._occupy_until(end_ticks)

    def _end_attempt(self, sent: Waiting, end_ticks: int, errors: BusErrors) -> None:
        """Count a destroyed transmission, and let the frame compete again or be lost."""
        self._is_destroyed = False
        self._completed.append(Delivery(self._ticks.whole_ns(end_ticks), NO_NODE, BIT_ERROR))
        self._occupy_until(end_ticks)
        self._queue.put_back(sent)
        if errors.on_destroyed(sent.sender, end_ticks, self._ticks):
            lost = self._queue.withdraw(sent.sender)
            self.lost_in_bus_off += lost
            self._awaited -= lost if sent.sender >= 0 else 0

    def _occupy_until(self, end_ticks: int) -> None:
        """Count the time of what has been on the wire, and its intermission."""
        free_ticks = end_ticks + self._intermission_ticks
        self._busy_ticks += free_ticks - self._next_start_ticks
        self._next_start_ticks = free_ticks
