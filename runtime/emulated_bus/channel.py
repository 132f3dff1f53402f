"""One channel of the broker: a bus with its own time, and the clients on it.

What a client has submitted still goes out when the client has gone, as the last frames of a program
that ends do. So that nobody fills the bus by coming and going, at most LEFT_FRAMES_MAX frames of
departed clients wait on one channel: beyond that, who left the most loses them.
"""

from collections.abc import Mapping
from struct import Struct

from runtime.bus_model import BusLoad, BusModel, Delivery
from runtime.emulated_bus.connection import Connection
from runtime.emulated_bus.protocol import OWN, pack_frame, record_format
from runtime.frame import EXTENDED, Frame
from runtime.statistics import DurationStatistics, DurationSummary

FRAMES_WAITING_MAX = 64
"""Frames of one client on their way before the broker stops reading from it."""
LEFT_FRAMES_MAX = 1024
"""Frames of clients that have gone which may wait on one channel."""
WATCHED_IDS_MAX = 256
"""Identifiers of a channel whose arbitration is timed: the first ones that are seen."""


class Channel:
    """One bus and the clients on it, by their numbers.

    ``bitrate_bit_s``, ``data_bitrate_bit_s``  as in BusModel
    """

    def __init__(self, bitrate_bit_s: int, data_bitrate_bit_s: int | None) -> None:
        self._model = BusModel(
            bitrate_bit_s, data_bitrate_bit_s, FRAMES_WAITING_MAX, self._on_start
        )
        self.members: dict[int, Connection] = {}
        self._left: dict[int, int] = {}
        self._discarded = 0
        self._delays: dict[tuple[int, bool], DurationStatistics] = {}

    @property
    def next_event_ns(self) -> int:
        """When the next frame is complete on the wire [ns]."""
        return self._model.next_event_ns

    @property
    def load(self) -> BusLoad:
        """What the bus has carried so far."""
        return self._model.load

    @property
    def discarded(self) -> int:
        """Frames of clients that had gone which were never sent."""
        return self._discarded

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
        """Put what a client has sent on the bus, as much as may wait there; returns if that is all.

        Raises ProtocolError for what is no frame.
        """
        while client.frames_waiting < FRAMES_WAITING_MAX:
            frame = client.take_frame()
            if frame is None:
                return True
            self._model.submit(frame, client.number, now_ns)
            client.frames_waiting += 1
        return False

    def advance(self, now_ns: int) -> list[Delivery]:
        """Return the frames that are complete, and let their senders have room for others."""
        completed = self._model.advance(now_ns)
        for _, sender, _ in completed:
            member = self.members.get(sender)
            if member is not None:
                member.frames_waiting -= 1
            elif self._left[sender] > 1:
                self._left[sender] -= 1
            else:
                del self._left[sender]
        return completed

    def queue(self, delivery: Delivery, time_ns: int) -> None:
        """Queue a frame, complete at ``time_ns`` of the wall clock, for every client it is for."""
        _, sender, frame = delivery
        packed: dict[Struct, bytes] = {}
        for member in self.members.values():
            if not member.wants(frame, sender):
                continue
            record = record_format(member.fd)
            if member.number == sender:
                own = frame._replace(flags=frame.flags | OWN)
                member.queue(pack_frame(record, own, time_ns))
                continue
            if record not in packed:
                packed[record] = pack_frame(record, frame, time_ns)
            member.queue(packed[record])

    def leave(self, client: Connection) -> None:
        """Forget a client; of what it has submitted as much goes out as may wait for the absent."""
        if self.members.pop(client.number, None) is None or not client.frames_waiting:
            return
        self._left[client.number] = client.frames_waiting
        for number in sorted(self._left, key=self._left.__getitem__, reverse=True):
            if sum(self._left.values()) <= LEFT_FRAMES_MAX:
                break
            withdrawn = self._model.withdraw(number)
            self._discarded += withdrawn
            self._left[number] -= withdrawn
            if not self._left[number]:
                del self._left[number]

    def _on_start(self, frame: Frame, delay_ns: int) -> None:
        """Time the arbitration of a frame."""
        key = (frame.can_id, bool(frame.flags & EXTENDED))
        statistics = self._delays.get(key)
        if statistics is None:
            if len(self._delays) >= WATCHED_IDS_MAX:
                return
            statistics = self._delays[key] = DurationStatistics()
        statistics.record(delay_ns)
