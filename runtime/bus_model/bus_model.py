"""A CAN bus: frames occupy the wire for their length, one after the other, by identifier.

Rules:

1. Whenever the bus is free, all waiting frames compete, including those submitted at that instant.
   The lowest arbitration field wins; of equal ones, the first submitted. A sender has a transmit
   buffer for each identifier, so that none of its frames waits behind one of lower priority.
2. A frame on the wire is never interrupted.
3. A frame is complete at its end of frame, and the next one may start three bits (intermission)
   later. Someone always acknowledges; clock tolerance is not modelled.
4. With ``errors``, a frame that noise destroys ends with BIT_ERROR (``bus_errors``) and
   competes again, first in its transmit buffer. Bus-off takes the frames of its sender off the
   bus until it has recovered.

Two nodes sending equal arbitration fields at once is an error on a real bus; here they queue.

Times are integer nanoseconds at the interface, and ticks (``bit_ticks``) inside. An end is rounded
up to the next nanosecond only when it is returned.

It serves the emulated bus in real time, and virtual time.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from heapq import heapify, heappop, heappush
from types import MappingProxyType
from typing import NamedTuple

from ..frame import Frame
from ..frame.frame import arbitration_field
from ..frame.length_with_stuff_bits import INTERMISSION_BITS, bits_of_eight_bytes
from ..node import NEVER_NS
from ..node.virtual_time_loop import Delivered
from .bit_ticks import bit_ticks
from .bus_errors import BusErrors, error_end_ticks
from .rest_bus import NO_TRAFFIC, RestBus, Traffic
from .socketcan_error_frames import BIT_ERROR

NO_NODE = -1
"""Sender of an error frame, which every controller sends."""
_ON_WIRE = -1
"""Arbitration field of a frame that has won the bus: it stays the first."""


class BusOverflowError(RuntimeError):
    """A sender's transmit buffer is full."""


class BusLoad(NamedTuple):
    """Totals of the bus.

    ``busy_ns``   time they took, intermissions included [ns]
    ``refused``   frames not taken because their transmit buffer was full
    ``until_ns``  the time that the totals cover, without a frame that is on the wire [ns]
    """

    frames: int
    busy_ns: int
    refused: int
    until_ns: int

    @property
    def busy_share(self) -> float:
        """Share of the time that the bus was busy, 0 to 1."""
        return self.busy_ns / max(self.until_ns, 1)


class BusModel:
    """A bus. ``now_ns`` must never decrease from one call to the next.

    ``data_bitrate_bit_s``  of FD frames' data phase with BITRATE_SWITCH; the nominal unless given
    ``queue_limit``         size of each transmit buffer [frames]; those of the traffic have one
    ``errors``              noise and error counters; without them every frame is sent whole
    ``traffic``             what else is sent, by nodes of negative numbers
    ``is_lossy``            whether a frame without room is lost and counted, as on a real bus
    ``senders``             names of senders, for errors

    ``next_event_ns``    when the next frame will be complete [ns]; NEVER_NS with no submitted frame
                         on the bus: no one waits for the traffic. Until the bus is free this may
                         change with every submission. With ``traffic`` it is a lower bound
    ``lost_in_bus_off``  frames of senders in bus-off

    Raises ValueError for a rate or a limit that is not positive.
    """

    def __init__(
        self,
        bitrate_bit_s: int,
        data_bitrate_bit_s: int | None = None,
        queue_limit: int = 1000,
        *,
        errors: BusErrors | None = None,
        traffic: Traffic = NO_TRAFFIC,
        is_lossy: bool = False,
        senders: Mapping[int, str] = MappingProxyType({}),
    ) -> None:
        if queue_limit <= 0:
            raise ValueError(f"the limit of a transmit buffer must be positive, not {queue_limit}")
        data_rate = bitrate_bit_s if data_bitrate_bit_s is None else data_bitrate_bit_s
        ticks = self._ticks = bit_ticks(bitrate_bit_s, data_rate)
        self._per_ns, self._bit_ticks, _ = ticks
        self._intermission_ticks = INTERMISSION_BITS * self._bit_ticks
        self._queue_limit = queue_limit
        self.errors, self.is_lossy, self._senders = errors, is_lossy, senders
        self._traffic = RestBus(traffic, ticks) if traffic.messages else None
        self._queue: list[tuple[int, int, int, int, Frame]] = []
        """Arbitration field, number, duration, sender and frame of those not complete yet; a heap.

        The first has the bus, or will have it unless another comes before ``_free_ticks``."""
        self._traffic_waiting = Counter[tuple[int, int]]()
        """Of the traffic, by arbitration field and sender: frames that are not on the wire yet."""
        self._completed: list[Delivered] = []
        self._free_ticks = self._idle_ticks = 0
        """When the first of the queue starts, or has started; and how long the bus was idle."""
        self._submitted = self._frames = self._refused = self.lost_in_bus_off = 0
        self.next_event_ns = NEVER_NS

    @property
    def load(self) -> BusLoad:
        """Totals so far."""
        busy_ns = self._ticks.whole_ns(self._free_ticks - self._idle_ticks)
        until_ns = self._ticks.whole_ns(self._free_ticks)
        return BusLoad(self._frames, busy_ns, self._refused, until_ns)

    def submit(self, frames: Sequence[Frame], sender: int, now_ns: int) -> None:
        """Queue ``frames`` of ``sender``, in order, ready to compete from ``now_ns`` on.

        Raises ValueError for a frame that cannot be sent, BusOverflowError for a full buffer unless
        the bus is lossy; those before it are queued.
        """
        if self._traffic is not None:
            self._release_before(now_ns, self._traffic)
        now_ticks, queue, limit = now_ns * self._per_ns, self._queue, self._queue_limit
        if self._free_ticks < now_ticks:
            self._carry(now_ticks)
        if self.errors is not None and self.errors.is_off(sender, now_ticks):
            self.lost_in_bus_off += len(frames)
            frames = ()
        for frame in frames:
            can_id, data, flags = frame
            if not flags and len(data) == 8:  # most are
                duration_ticks = bits_of_eight_bytes(can_id, data) * self._bit_ticks
                arbitration = can_id << 21
            else:
                duration_ticks = self._ticks.of_frame(frame)
                arbitration = arbitration_field(frame)
            if len(queue) < limit or self._has_room(arbitration, sender):
                self._submitted = number = self._submitted + 1
                heappush(queue, (arbitration, number, duration_ticks, sender, frame))
            elif not self.is_lossy:
                who = self._senders.get(sender, f"sender {sender}")
                raise BusOverflowError(
                    f"{who} has {limit} frames of identifier 0x{can_id:03X} waiting for the bus"
                )
        self._look_ahead()

    def is_off(self, sender: int, now_ns: int) -> bool:
        """Whether a sender is in bus-off; lets it take part again when that is over."""
        return self.errors is not None and self.errors.is_off(sender, now_ns * self._per_ns)

    def advance(self, now_ns: int) -> list[Delivered]:
        """Return the frames completed up to ``now_ns`` and not returned before, in order."""
        if self._traffic is not None:
            self._release_before(now_ns, self._traffic)
        self._carry(now_ns * self._per_ns)
        completed, self._completed = self._completed, []
        self._look_ahead()
        return completed

    def _look_ahead(self) -> None:
        """Find the next end of a frame."""
        queue = self._queue
        if self._completed:
            self.next_event_ns = self._completed[0][0]
        elif not queue or (self._traffic is not None and all(one[3] < 0 for one in queue)):
            self.next_event_ns = NEVER_NS
        else:
            end_ticks = self._free_ticks + queue[0][2]
            if self.errors is not None:
                end_ticks, _ = self._end_in_noise(self._free_ticks, end_ticks, self.errors)
            self.next_event_ns = -(-end_ticks // self._per_ns)

    def _release_before(self, now_ns: int, traffic: RestBus) -> None:
        """Let the messages of the traffic compete that are due before now and have room."""
        while (due_ns := traffic.next_due_ns) < now_ns:
            self._carry(due_ns * self._per_ns)
            arbitration, duration_ticks, sender, frame = traffic.ready
            has_room = not self._traffic_waiting[arbitration, sender]
            self._refused += not has_room
            if has_room and not self.is_off(sender, due_ns):
                self._traffic_waiting[arbitration, sender] = 1
                self._submitted = number = self._submitted + 1
                heappush(self._queue, (arbitration, number, duration_ticks, sender, frame))
            traffic.release(counts_on=has_room)

    def _has_room(self, arbitration: int, sender: int) -> bool:
        """Whether a transmit buffer has room; counts the frame as refused if not."""
        waiting = sum(field == arbitration and by == sender for field, _, _, by, _ in self._queue)
        self._refused += waiting >= self._queue_limit
        return waiting < self._queue_limit

    def _carry(self, now_ticks: int) -> None:
        """Complete frames that have ended by now, and decide all arbitrations before now.

        One at this instant stays open, because a frame submitted at this instant still competes.
        """
        queue, errors, free_ticks = self._queue, self.errors, self._free_ticks
        while free_ticks < now_ticks:
            if not queue:
                self._idle_ticks += now_ticks - free_ticks
                free_ticks = now_ticks
                break
            arbitration, number, duration_ticks, sender, frame = queue[0]
            end_ticks, is_whole = free_ticks + duration_ticks, True
            if errors is not None:
                end_ticks, is_whole = self._end_in_noise(free_ticks, end_ticks, errors)
            if sender < 0 and arbitration != _ON_WIRE:
                self._traffic_waiting[arbitration, sender] -= 1
            if end_ticks > now_ticks:
                if arbitration != _ON_WIRE:
                    queue[0] = (_ON_WIRE, number, duration_ticks, sender, frame)
                break
            heappop(queue)
            free_ticks = end_ticks + self._intermission_ticks
            end_ns = -(-end_ticks // self._per_ns)
            if is_whole:
                self._frames += 1
                self._completed.append((end_ns, sender, frame))
                if errors is not None:
                    errors.on_whole(sender)
            elif errors is not None:
                self._completed.append((end_ns, NO_NODE, BIT_ERROR))
                entry = arbitration_field(frame), number, duration_ticks, sender, frame
                heappush(queue, entry)
                if sender < 0:
                    self._traffic_waiting[entry[0], sender] += 1
                if errors.on_destroyed(sender, end_ticks, self._ticks):
                    self._withdraw(sender)
        self._free_ticks = free_ticks

    def _end_in_noise(self, free_ticks: int, end_ticks: int, errors: BusErrors) -> tuple[int, bool]:
        """Return when the first of the queue leaves the bus, and whether it is whole by then."""
        hit_ns = errors.next_hit_ns(-(-free_ticks // self._per_ns))
        hit_ticks = hit_ns * self._per_ns
        if hit_ticks >= end_ticks:
            return end_ticks, True
        return error_end_ticks(free_ticks, hit_ticks, self._ticks), False

    def _withdraw(self, sender: int) -> None:
        """Take back every frame of a sender in bus-off."""
        before = len(self._queue)
        self._queue[:] = [one for one in self._queue if one[3] != sender]
        heapify(self._queue)
        for buffer in [buffer for buffer in self._traffic_waiting if buffer[1] == sender]:
            del self._traffic_waiting[buffer]
        self.lost_in_bus_off += before - len(self._queue)
