"""The broker: one loop that waits for the clients and for the end of the frame on each wire.

Each channel is a bus of its own with its own time. A frame competes for the wire from the moment
the broker reads it, and is delivered at its end of frame, never earlier. A client that floods is
not read until its frames have gone out, so that it waits in ``send`` as for a full controller; one
that does not read is disconnected. Neither holds up the others.

Waiting is by ``select`` because it counts microseconds; Python's epoll and poll round up to the
next millisecond, which is four frames.
"""

import logging
import select
import socket
import time
from struct import Struct

from runtime.bus_model import BusLoad, BusModel, Delivery
from runtime.emulated_bus.connection import Connection, ConnectionLostError
from runtime.emulated_bus.protocol import (
    OWN,
    Answer,
    Hello,
    ProtocolError,
    pack_frame,
    record_format,
)
from runtime.emulated_bus.wall_clock import WallClock
from runtime.node import NEVER_NS

CLIENTS_MAX = 200
"""More would come near the 1024 descriptors that ``select`` can wait for."""
CHANNELS_MAX = 64
FRAMES_WAITING_MAX = 64
"""Frames of one client on their way before the broker stops reading from it."""

_LOG = logging.getLogger(__name__)


class _Channel:
    """One bus and the clients on it, by their numbers."""

    def __init__(self, model: BusModel) -> None:
        self.model = model
        self.members: dict[int, Connection] = {}

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


class Broker:
    """Serves the clients that connect to ``listener``.

    ``bitrate_bit_s``       of every channel [bit/s]
    ``data_bitrate_bit_s``  of the data phase of CAN FD frames [bit/s]; None for classic CAN only
    """

    def __init__(
        self, listener: socket.socket, bitrate_bit_s: int, data_bitrate_bit_s: int | None = None
    ) -> None:
        listener.setblocking(False)
        self._listener = listener
        self._bitrate_bit_s = bitrate_bit_s
        self._data_bitrate_bit_s = data_bitrate_bit_s
        self._wall_clock = WallClock()
        self._channels: dict[str, _Channel] = {}
        self._clients: set[Connection] = set()
        self._next_number = 1
        self._readers: set[Connection] = set()
        self._writers: set[Connection] = set()

    @property
    def loads(self) -> dict[str, BusLoad]:
        """What each channel has carried so far."""
        return {name: channel.model.load for name, channel in self._channels.items()}

    def run(self, end_descriptor: int | None = None) -> None:
        """Serve until ``end_descriptor`` is readable or closed, or until KeyboardInterrupt."""
        sources = [] if end_descriptor is None else [end_descriptor]
        try:
            while self._serve_once(sources):
                pass
        finally:
            for client in self._clients:
                client.close()

    def _serve_once(self, end_descriptors: list[int]) -> bool:
        """Wait until something is to be done, and do it; returns False at the end."""
        sources: list[int | socket.socket | Connection]
        sources = [*end_descriptors, self._listener, *self._readers]
        readable, writable, _ = select.select(sources, self._writers, (), self._timeout_s())
        now_ns = time.monotonic_ns()
        # First what has been complete until now: what is read below competes only from now on.
        for channel in self._channels.values():
            if channel.model.next_event_ns <= now_ns:
                self._deliver(channel, now_ns)
        for source in readable:
            if isinstance(source, int):
                return False
            if isinstance(source, socket.socket):
                self._accept()
            elif source in self._readers:
                self._read(source, now_ns)
        for client in writable:
            if client in self._writers:
                self._flush(client)
        return True

    def _timeout_s(self) -> float | None:
        """Time until the next end of frame on any channel [s]; None with nothing on the way."""
        next_ns = min(
            (channel.model.next_event_ns for channel in self._channels.values()), default=NEVER_NS
        )
        if next_ns == NEVER_NS:
            return None
        return max(next_ns - time.monotonic_ns(), 0) * 1e-9

    def _deliver(self, channel: _Channel, now_ns: int) -> None:
        """Send out the frames that are complete, and let their senders submit more."""
        self._wall_clock.update()
        for delivery in channel.model.advance(now_ns):
            channel.queue(delivery, self._wall_clock.at(delivery.end_ns))
            sender = channel.members.get(delivery.sender)
            if sender is not None:
                sender.frames_waiting -= 1
        for member in tuple(channel.members.values()):
            if member.has_outgoing:
                self._flush(member)
            if member in self._clients and member not in self._readers:
                self._submit(member, now_ns)

    def _accept(self) -> None:
        """Take a new client."""
        try:
            connection, _ = self._listener.accept()
        except OSError as error:
            # It has gone again before it was taken.
            _LOG.info("a client was lost before it was accepted: %s", error)
            return
        if connection.family == socket.AF_INET:
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        client = Connection(connection, self._next_number)
        self._next_number += 1
        self._clients.add(client)
        self._readers.add(client)
        if len(self._clients) > CLIENTS_MAX:
            self._refuse(client, f"it has {CLIENTS_MAX} clients already")

    def _read(self, client: Connection, now_ns: int) -> None:
        """Take in what a client has sent."""
        try:
            client.read()
            if client.hello is None:
                hello = client.take_hello()
                if hello is None:
                    return
                self._welcome(client, hello)
        except (ConnectionLostError, ProtocolError) as reason:
            self._drop(client, str(reason))
            return
        self._submit(client, now_ns)

    def _welcome(self, client: Connection, hello: Hello) -> None:
        """Let a client join the channel it asks for, or refuse it."""
        reason = self._obstacle(hello)
        if reason:
            self._refuse(client, reason)
            return
        if hello.channel not in self._channels:
            model = BusModel(self._bitrate_bit_s, self._data_bitrate_bit_s, FRAMES_WAITING_MAX)
            self._channels[hello.channel] = _Channel(model)
        self._channels[hello.channel].members[client.number] = client
        _LOG.info("%s joins", client)
        client.queue(self._answer("").pack())
        self._flush(client)

    def _obstacle(self, hello: Hello) -> str:
        """Why a client cannot join; empty when it can."""
        if hello.fd and self._data_bitrate_bit_s is None:
            return "it carries classic frames only; start it with --data-bitrate for CAN FD"
        for wanted, actual in (
            (hello.bitrate_bit_s, self._bitrate_bit_s),
            (hello.data_bitrate_bit_s, self._data_bitrate_bit_s),
        ):
            if wanted and actual and wanted != actual:
                return f"it runs at {actual} bit/s, not at {wanted}"
        if hello.channel not in self._channels and len(self._channels) >= CHANNELS_MAX:
            return f"it has {CHANNELS_MAX} channels already"
        return ""

    def _answer(self, reason: str) -> Answer:
        return Answer(self._bitrate_bit_s, self._data_bitrate_bit_s or 0, reason)

    def _refuse(self, client: Connection, reason: str) -> None:
        """Tell a client why it cannot join, and close."""
        client.queue(self._answer(reason).pack())
        self._flush(client)
        self._drop(client, f"refused: {reason}")

    def _submit(self, client: Connection, now_ns: int) -> None:
        """Put the frames a client has sent on its bus, as many as may wait there.

        The client is read again only when all are taken; that bounds what waits here for it.
        """
        if client.hello is None or client not in self._clients:
            return
        model = self._channels[client.hello.channel].model
        self._readers.discard(client)
        try:
            while client.frames_waiting < FRAMES_WAITING_MAX:
                frame = client.take_frame()
                if frame is None:
                    self._readers.add(client)
                    return
                model.submit(frame, client.number, now_ns)
                client.frames_waiting += 1
        except ProtocolError as reason:
            self._drop(client, str(reason))

    def _flush(self, client: Connection) -> None:
        """Write what waits for a client, and come back when its socket takes more."""
        try:
            client.flush()
        except ConnectionLostError as reason:
            self._drop(client, str(reason))
            return
        if client.has_outgoing:
            self._writers.add(client)
        else:
            self._writers.discard(client)

    def _drop(self, client: Connection, reason: str) -> None:
        """Forget a client; what it has submitted still goes out."""
        if client not in self._clients:
            return
        _LOG.log(
            logging.WARNING if reason else logging.INFO,
            "%s leaves%s",
            client,
            f": {reason}" if reason else "",
        )
        self._clients.discard(client)
        self._readers.discard(client)
        self._writers.discard(client)
        if client.hello is not None and client.hello.channel in self._channels:
            self._channels[client.hello.channel].members.pop(client.number, None)
        client.close()
