"""One channel of the broker: a bus with its own time, and the clients on it.

A client has a transmit buffer for each identifier that it sends, like a CAN controller with enough
buffers. When one is full the client is notified, and itself refuses further frames of that
identifier, so that other frames do not wait behind them. A client that sends more is not read.

Frames that a client has submitted are still sent after it has gone, like the last frames of a
program that ends. At most LEFT_FRAMES_MAX frames of departed clients wait on one channel, so that
no client fills the bus by joining and leaving. Beyond that, the client that left the most loses
its frames.
"""

from collections.abc import Mapping
from struct import Struct

from ..bus_model import BusLoad, BusModel, Delivery
from ..frame import EXTENDED, Frame
from ..node import NEVER_NS
from ..statistics import DurationStatistics, DurationSummary
from .bus_off import BUS_OFF_FRAME, RESTARTED_FRAME, Recovery
from .connection import BufferKey, Connection
from .protocol import OWN, Buffer, BusOff, pack_buffer, pack_frame

BUFFER_FULL = 16
"""Frames in a transmit buffer at which its client is notified that it is full."""
FRAMES_WAITING_MAX = 64
"""Frames in a transmit buffer at which the broker stops reading from its client. There is room for
frames on their way when the buffer became full, and for a client that waits in ``send``."""
BUFFERS_MAX = 32
"""Waiting identifiers of one client at which the broker stops reading from it."""
_FIFO: BufferKey = (-1, False)
"""The only transmit buffer of a client with a FIFO."""
LEFT_FRAMES_MAX = 1024
"""Frames of departed clients that may wait on one channel."""
WATCHED_IDS_MAX = 256
"""The first identifiers on a channel; arbitration time and sender are recorded for these only."""


class Channel:
    """One bus and the clients on it, by their numbers.

    ``bitrate_bit_s``, ``data_bitrate_bit_s``, ``is_fifo``  as in BusModel
    """

    def __init__(
        self, bitrate_bit_s: int, data_bitrate_bit_s: int | None, *, is_fifo: bool = False
    ) -> None:
        self._model = BusModel(
            bitrate_bit_s, data_bitrate_bit_s, FRAMES_WAITING_MAX, self._on_start, is_fifo=is_fifo
        )
        self._is_fifo = is_fifo
        self._bitrate_bit_s = bitrate_bit_s
        self.members: dict[int, Connection] = {}
        self._senders: dict[tuple[int, bool], int] = {}
        self._quiet_ns = 0
        self._bus_offs = 0
        self._lost_in_bus_off = 0
        self._left: dict[int, int] = {}
        self._discarded = 0
        self._delays: dict[tuple[int, bool], DurationStatistics] = {}

    @property
    def next_event_ns(self) -> int:
        """When the next frame is complete on the wire, or a bus-off may be over [ns]."""
        next_ns = self._model.next_event_ns
        if not self._bus_offs:
            return next_ns
        looks_ns = [one.recovery.next_look_ns for one in self.members.values() if one.recovery]
        return min([next_ns, *looks_ns])

    @property
    def load(self) -> BusLoad:
        """Totals of the bus so far."""
        return self._model.load

    @property
    def discarded(self) -> int:
        """Frames of departed clients that were never sent."""
        return self._discarded

    @property
    def bus_offs(self) -> int:
        """How often a client has gone into bus-off."""
        return self._bus_offs

    @property
    def lost_in_bus_off(self) -> int:
        """Frames lost in bus-off: sent then, or still waiting for the wire."""
        return self._lost_in_bus_off

    @property
    def arbitration_delays(self) -> Mapping[str, DurationSummary]:
        """From submission to start of frame, by identifier: 3 hexadecimal digits, or 8 for 29 bit.

        Of the first WATCHED_IDS_MAX identifiers on this channel.
        """
        return {
            f"{can_id:0{8 if is_extended else 3}X}": statistics.summary()
            for (can_id, is_extended), statistics in sorted(self._delays.items())
        }

    def submit(self, client: Connection, now_ns: int) -> bool:
        """Submit a client's frames, as many as may wait; returns whether these were all.

        Raises ProtocolError for an invalid frame.
        """
        waiting_of = client.waiting
        while (frame := client.take_frame()) is not None:
            if client.recovery is not None:
                self._lost_in_bus_off += 1
                continue
            can_id, _, flags = frame
            key = (can_id, flags & EXTENDED != 0)
            buffer = _FIFO if self._is_fifo else key
            waiting = waiting_of.get(buffer, 0) + 1
            if waiting > FRAMES_WAITING_MAX or (waiting == 1 and len(waiting_of) >= BUFFERS_MAX):
                client.put_back(frame)
                return False
            self._model.submit(frame, client.number, now_ns)
            waiting_of[buffer] = waiting
            if waiting >= BUFFER_FULL and not self._is_fifo:
                self._report_full(client, key)
            if key in self._senders or len(self._senders) < WATCHED_IDS_MAX:
                self._senders[key] = client.number
        return True

    def go_off(self, request: BusOff, now_ns: int, time_ns: int) -> Connection | None:
        """Put a client into bus-off, or change the restart time of one that is.

        A frame on the wire is still completed. Returns the client if it was not in bus-off before;
        None also if no client has sent the identifier.

        ``time_ns``  now, by the wall clock [ns]
        """
        can_id, extended, restart_after_ns = request
        client = self.members.get(self._senders.get((can_id, extended), 0))
        if client is None:
            return None
        restart_ns = now_ns + restart_after_ns
        if client.recovery is not None:
            client.recovery.restart_ns = min(client.recovery.restart_ns, restart_ns)
            return None
        withdrawn = self._model.withdraw(client.number)
        for frame in withdrawn:
            self._make_room(client, frame)
        self._lost_in_bus_off += len(withdrawn)
        self._bus_offs += 1
        client.recovery = Recovery(restart_ns, self._bitrate_bit_s)
        client.queue(pack_frame(client.record, BUS_OFF_FRAME, time_ns))
        return client

    def come_back(self, now_ns: int, time_ns: int) -> list[Connection]:
        """Let clients whose bus-off is over take part again; returns them.

        ``time_ns``  now, by the wall clock [ns]
        """
        if not self._bus_offs:
            return []
        if self._model.next_event_ns == NEVER_NS:
            self._quiet_ns = now_ns
        back = [
            client
            for client in self.members.values()
            if client.recovery is not None
            and client.recovery.is_over(now_ns, self._model.load, self._quiet_ns)
        ]
        for client in back:
            client.recovery = None
            client.queue(pack_frame(client.record, RESTARTED_FRAME, time_ns))
        return back

    def advance(self, now_ns: int) -> list[Delivery]:
        """Return the completed frames, and free their place in the transmit buffers."""
        completed = self._model.advance(now_ns)
        if completed:
            self._quiet_ns = completed[-1].end_ns
        for _, sender, frame in completed:
            member = self.members.get(sender)
            if member is not None:
                self._make_room(member, frame)
            elif self._left[sender] > 1:
                self._left[sender] -= 1
            else:
                del self._left[sender]
        return completed

    def queue(self, delivery: Delivery, time_ns: int) -> None:
        """Queue a frame, complete at wall-clock time ``time_ns``, for all that want it."""
        _, sender, frame = delivery
        packed: dict[Struct, bytes] = {}
        for member in self.members.values():
            if not member.wants(frame, sender):
                continue
            record = member.record
            if member.number == sender:
                own = frame._replace(flags=frame.flags | OWN)
                member.queue(pack_frame(record, own, time_ns))
                continue
            if record not in packed:
                packed[record] = pack_frame(record, frame, time_ns)
            member.queue(packed[record])

    def leave(self, client: Connection) -> None:
        """Remove a client; its frames are still sent, as many as may wait for departed clients."""
        if self.members.pop(client.number, None) is None or not client.frames_waiting:
            return
        self._left[client.number] = client.frames_waiting
        for number in sorted(self._left, key=self._left.__getitem__, reverse=True):
            if sum(self._left.values()) <= LEFT_FRAMES_MAX:
                break
            withdrawn = len(self._model.withdraw(number))
            self._discarded += withdrawn
            self._left[number] -= withdrawn
            if not self._left[number]:
                del self._left[number]

    def _report_full(self, client: Connection, buffer: BufferKey) -> None:
        """Notify the client to refuse frames of this transmit buffer until there is room.

        A client that does not read misses this, and is held back in the end.
        """
        if buffer not in client.full and not client.is_behind:
            client.full.add(buffer)
            client.queue(pack_buffer(client.record, Buffer(*buffer, has_room=False)))

    def _make_room(self, client: Connection, frame: Frame) -> None:
        """Count a frame that has left its transmit buffer."""
        can_id, _, flags = frame
        buffer = _FIFO if self._is_fifo else (can_id, flags & EXTENDED != 0)
        waiting = client.waiting.pop(buffer) - 1
        if waiting:
            client.waiting[buffer] = waiting
        if waiting == BUFFER_FULL - 1 and buffer in client.full:
            client.full.discard(buffer)
            client.queue(pack_buffer(client.record, Buffer(*buffer, has_room=True)))

    def _on_start(self, frame: Frame, delay_ns: int) -> None:
        """Record the arbitration time of a frame."""
        can_id, _, flags = frame
        key = (can_id, flags & EXTENDED != 0)
        statistics = self._delays.get(key)
        if statistics is None:
            if len(self._delays) >= WATCHED_IDS_MAX:
                return
            statistics = self._delays[key] = DurationStatistics()
        statistics.record(delay_ns)
