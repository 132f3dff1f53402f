"""The broker: one loop that waits for the clients and for the end of the frame on each wire.

Each channel is a bus of its own with its own time. A frame competes for the wire from the moment
the broker reads it, and is delivered at its end of frame, never earlier.

No client can stop another, and everything that waits for a client is bounded. A client that

    floods the bus         is not read until frames have gone out, and so waits in ``send``
    does not read          is disconnected when OUTGOING_BYTES_MAX wait for it
    sends garbage          is disconnected at the first invalid record

Waiting is by ``select`` because it counts microseconds; Python's epoll and poll round up to the
next millisecond, which is four frames.
"""

import select
import socket
import time
from collections.abc import Callable, Sequence
from contextlib import suppress

from ..bus_model.bus_model import BusModel
from ..bus_model.rest_bus import NO_TRAFFIC, Traffic
from ..node import NEVER_NS, NS_PER_MS, NS_PER_S
from ..node.virtual_time_loop import Delivered
from .broker_connection import FRAMES_WAITING_MAX, Cause, Connection, ConnectionLostError
from .protocol import Answer, Hello, ProtocolError, pack_frame

PACE_NS = NS_PER_MS
"""How long a channel with traffic is left alone at most."""


class Channel:
    """One bus, and as ``members`` the clients on it by their numbers.

    A client that leaves is taken out; its frames are still sent. The rest bus is that of the bus
    model, as in virtual time; its time begins with the channel. Such a channel is advanced every
    PACE_NS at least, so that frames of the traffic reach the clients up to that much late, with
    their right times. Bit errors belong to virtual time alone.

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
                self.model.submit((frame,), client.number, bus_ns)
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


CHANNELS_MAX = 64
CLIENTS_MAX = 200
"""More would come near the 1024 descriptors that ``select`` can wait for."""
_SEED_STEP = 1_000_003
"""Distance between the seeds of two channels."""


class Broker:
    """Serves the clients that connect to ``listener``.

    ``data_bitrate_bit_s``  of the data phase of CAN FD frames [bit/s]; None for classic CAN only
    ``print_line``          prints one line, or drops it: the broker does not wait for its reader
    ``disconnections``      how many clients have left, by cause
    ``held_back``           how often a client was not read on because its frames waited
    """

    def __init__(
        self,
        listener: socket.socket,
        bitrate_bit_s: int,
        data_bitrate_bit_s: int | None,
        print_line: Callable[[str], object],
        clock_ns: Callable[[], int] = time.monotonic_ns,
        traffic: Traffic = NO_TRAFFIC,
    ) -> None:
        listener.setblocking(False)
        self._listener = listener
        self._bitrate_bit_s = bitrate_bit_s
        self._data_bitrate_bit_s = data_bitrate_bit_s
        self._print_line = print_line
        self.disconnections = dict.fromkeys(Cause, 0)
        self._clock_ns = clock_ns
        self._traffic = traffic
        # Time stamps count from here: a second on the bus stays a second, whatever sets the clock.
        self._to_wall_clock_ns = time.time_ns() - time.monotonic_ns()
        self.clients: set[Connection] = set()
        self._most = self._served = self.held_back = 0
        self.channels: dict[str, Channel] = {}

    def summary(self, duration_ns: int) -> str:
        """Return in one line what it has carried and whom it has disconnected."""
        parts = [f"ran {duration_ns / NS_PER_S:.1f} s"]
        for name, channel in sorted(self.channels.items()):
            load = channel.model.load
            parts.append(f"{name} {load.frames} frames, load {load.busy_ns / duration_ns:.1%}")
        parts.append(f"{self._served} clients, {self._most} at once")
        gone = [
            f"{count} {cause.replace('_', ' ')}"
            for cause, count in self.disconnections.items()
            if count and cause is not Cause.LEFT
        ]
        if gone:
            parts.append(f"disconnected: {', '.join(gone)}")
        if self.held_back:
            parts.append(f"held back {self.held_back}x")
        return "; ".join(parts)

    def run(self, ends: Sequence[int] = ()) -> None:
        """Serve until one of the descriptors ``ends`` is readable or closed."""
        try:
            while self.serve(self._timeout_s(), ends):
                pass
        finally:
            for client in self.clients:
                client.close()

    def serve(self, timeout_s: float | None, ends: Sequence[int] = ()) -> bool:
        """Wait at most ``timeout_s`` for something to do, and do it; returns False at the end."""
        readers = [client for client in self.clients if not client.is_held_back]
        writers = [client for client in self.clients if client.has_outgoing]
        sources: list[int | socket.socket | Connection] = [*readers, *ends, self._listener]
        readable, writable, _ = select.select(sources, writers, (), timeout_s)
        now_ns = self._clock_ns()
        # First what has been complete until now: what is read below competes only from now on.
        for channel in self.channels.values():
            if channel.next_event_ns <= now_ns:
                self._deliver(channel, now_ns)
        for source in readable:
            if isinstance(source, int):
                return False
            if isinstance(source, socket.socket):
                self._accept()
            elif not source.is_held_back:
                self._attend(source, now_ns, is_readable=True)
        for client in writable:
            self._attend(client, now_ns)
        return True

    def _timeout_s(self) -> float | None:
        """Time until the next thing that comes by itself [s]; None with nothing under way."""
        now_ns = self._clock_ns()
        next_ns = min((one.next_event_ns for one in self.channels.values()), default=NEVER_NS)
        return None if next_ns == NEVER_NS else max(next_ns - now_ns, 0) / NS_PER_S

    def _deliver(self, channel: Channel, now_ns: int) -> None:
        """Send out the frames that are complete, and let their senders submit more."""
        channel.deliver(now_ns, self._to_wall_clock_ns)
        for member in tuple(channel.members.values()):
            if member.has_outgoing or member.is_held_back:
                self._attend(member, now_ns)

    def _accept(self) -> None:
        try:
            connection, _ = self._listener.accept()
        except OSError:
            return  # it has gone again, or waits until the host has a descriptor for it
        if connection.family == socket.AF_INET:
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._served += 1
        client = Connection(connection, self._served)
        others = len(self.clients)
        self.clients.add(client)
        if others >= CLIENTS_MAX:
            self._refuse(client, f"it has {others} clients already")
        else:
            self._most = max(self._most, others + 1)

    def _attend(self, client: Connection, now_ns: int, *, is_readable: bool = False) -> None:
        """Read, put on the bus and write what there is of a client that has not left before.

        As many of its frames are put there as may wait. It is read again only when all are there;
        that bounds what waits here for it.
        """
        if client not in self.clients:
            return
        try:
            if is_readable:
                client.read()
            if client.hello is None and (hello := client.read_hello()) is not None:
                if reason := self._obstacle(hello):
                    self._refuse(client, reason)
                    return
                self._welcome(client, hello.channel, now_ns)
            if client.hello is not None:
                was_held_back = client.is_held_back
                client.is_held_back = not self.channels[client.hello.channel].submit(client, now_ns)
                self.held_back += client.is_held_back and not was_held_back
            if client.has_outgoing:
                client.flush()
        except ConnectionLostError as reason:
            self._drop(client, reason.cause, str(reason))
        except ProtocolError as reason:
            self._drop(client, Cause.GARBAGE, str(reason))

    def _welcome(self, client: Connection, name: str, now_ns: int) -> None:
        if name not in self.channels:
            # Each with phases of its own; those of the first are those of virtual time.
            seed = self._traffic.seed + _SEED_STEP * len(self.channels)
            rates = self._bitrate_bit_s, self._data_bitrate_bit_s
            traffic = self._traffic._replace(seed=seed)
            self.channels[name] = Channel(*rates, traffic, now_ns)
        self.channels[name].members[client.number] = client
        client.queue(self._answer(""))

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
        if hello.channel not in self.channels and len(self.channels) >= CHANNELS_MAX:
            return f"it has {CHANNELS_MAX} channels already"
        return ""

    def _answer(self, reason: str) -> bytes:
        return Answer(self._bitrate_bit_s, self._data_bitrate_bit_s or 0, reason).pack()

    def _refuse(self, client: Connection, reason: str) -> None:
        client.queue(self._answer(reason))
        with suppress(ConnectionLostError):
            client.flush()
        self._drop(client, Cause.REFUSED, f"refused: {reason}")

    def _drop(self, client: Connection, cause: Cause, detail: str) -> None:
        """Forget a client; what it has submitted still goes out."""
        self.disconnections[cause] += 1
        if cause is not Cause.LEFT:
            self._print_line(f"{client} leaves: {detail}")
        self.clients.discard(client)
        if client.hello is not None and client.hello.channel in self.channels:
            self.channels[client.hello.channel].members.pop(client.number, None)
        client.close()
