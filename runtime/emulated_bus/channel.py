"""One channel of the broker: a bus with its own time, and the clients on it.

The rest bus is that of the bus model, as in virtual time; its time begins with the channel. Such a
channel is advanced every PACE_NS at least, so that frames of the traffic reach the clients up to
that much late, with their right times. Bit errors belong to virtual time alone.
"""

from ..bus_model.bus_model import BusModel
from ..bus_model.rest_bus import NO_TRAFFIC, Traffic
from ..node import NEVER_NS, NS_PER_MS
from ..node.virtual_time_loop import Delivered
from .broker_connection import FRAMES_WAITING_MAX, Connection
from .protocol import ProtocolError, pack_frame

PACE_NS = NS_PER_MS
"""How long a channel with traffic is left alone at most."""


class Channel:
    """One bus, and as ``members`` the clients on it by their numbers.

    A client that leaves is taken out; its frames are still sent.

    ``bitrate_bit_s``, ``data_bitrate_bit_s``  as in BusModel
    ``start_ns``                               when the time of its bus begins [ns]
    """

    def __init__(
        self,
        bitrate_bit_s: int,
        data_bitrate_bit_s: int | None,
        traffic: Traffic = NO_TRAFFIC,
        start_ns: int = 0,
    ) -> None:
        self.members: dict[int, Connection] = {}
        self.model = BusModel(bitrate_bit_s, data_bitrate_bit_s, traffic=traffic)
        self._start_ns = start_ns
        self._pace_ns = start_ns if traffic.messages else NEVER_NS

    @property
    def next_event_ns(self) -> int:
        """When the next frame is complete on the wire [ns]."""
        return min(self.model.next_event_ns + self._start_ns, self._pace_ns)

    def submit(self, client: Connection, now_ns: int) -> bool:
        """Submit a client's frames, as many as may wait; returns whether these were all.

        Raises ProtocolError for an invalid frame.
        """
        bus_ns = now_ns - self._start_ns
        while client.waiting < FRAMES_WAITING_MAX:
            frame = client.next_frame()
            if frame is None:
                return True
            try:
                self.model.submit(frame, client.number, bus_ns)
            except ValueError as error:
                raise ProtocolError(str(error)) from error
            client.waiting += 1
        return False

    def deliver(self, now_ns: int, to_wall_clock_ns: int = 0) -> list[Delivered]:
        """Queue what is complete for all that want it, and free its place in its sender's buffer.

        Returns it, each with its end on the clock of ``now_ns``.
        """
        completed = [
            (end_ns + self._start_ns, sender, frame)
            for end_ns, sender, frame in self.model.advance(now_ns - self._start_ns)
        ]
        for end_ns, sender, frame in completed:
            for member in self.members.values():
                member.waiting -= member.number == sender
                if member.wants(frame, sender):
                    time_ns = end_ns + to_wall_clock_ns
                    member.queue(pack_frame(member.record_bytes, frame, time_ns))
        if self._pace_ns != NEVER_NS:
            self._pace_ns = now_ns + PACE_NS
        return completed
