"""The broker: one loop that waits for the clients and for the end of the frame on each wire.

Each channel is a bus of its own with its own time. A frame competes for the wire from the moment
the broker reads it, and is delivered at its end of frame, never earlier.

No client can delay another, and everything that waits for a client is bounded. A client that

    floods the bus         is notified which of its transmit buffers is full; if it continues, it is
                           not read until frames have gone out, and so waits in ``send``
    keeps changing filters is read again FILTER_CHANGE_NS later for each change
    does not read          is disconnected when OUTGOING_BYTES_MAX wait for it
    sends garbage          is disconnected at the first invalid record
    sends no hello         is disconnected after HELLO_TIMEOUT_NS
    leaves and returns     leaves at most LEFT_FRAMES_MAX frames behind
    requests a bus-off     is disconnected unless this broker allows it

Waiting is by ``select`` because it counts microseconds; Python's epoll and poll round up to the
next millisecond, which is four frames.
"""

import select
import socket
import time
from collections.abc import Callable, Sequence

from ..node import NEVER_NS, NS_PER_S, NS_PER_US
from ..node.statistics import DurationStatistics, DurationSummary
from .broker_clients import Clients
from .broker_connection import Connection, ConnectionLostError
from .channel import UNDISTURBED, Channel, ChannelConditions
from .journal import Cause, Journal
from .protocol import Answer, BusOff, Hello, ProtocolError
from .wall_clock import WallClock

CHANNELS_MAX = 64
FILTER_CHANGE_NS = 50 * NS_PER_US
"""What a change of filters costs its client: many times what it costs the broker."""
_SEED_STEP = 1_000_003
"""Distance between the seeds of two channels, larger than that of the nodes of one."""


class Broker:
    """Serves the clients that connect to ``listener``.

    ``bitrate_bit_s``       of every channel [bit/s]
    ``data_bitrate_bit_s``  of the data phase of CAN FD frames [bit/s]; None for classic CAN only
    ``journal``             reports who comes and goes
    ``clock_ns``            monotonic clock [ns]
    ``takes_bus_off``       whether a client may send another one, or itself, into bus-off
    ``is_fifo``             whether the frames of one client keep their order
    ``conditions``          rest bus and errors on every channel

    ``clients``             who is connected
    ``channels``            all so far, by name
    """

    def __init__(
        self,
        listener: socket.socket,
        bitrate_bit_s: int,
        data_bitrate_bit_s: int | None,
        journal: Journal,
        clock_ns: Callable[[], int] = time.monotonic_ns,
        *,
        takes_bus_off: bool = False,
        is_fifo: bool = False,
        conditions: ChannelConditions = UNDISTURBED,
    ) -> None:
        self.clients = Clients(listener, journal, self._leave)
        self._bitrate_bit_s = bitrate_bit_s
        self._data_bitrate_bit_s = data_bitrate_bit_s
        self._journal = journal
        self._clock_ns = clock_ns
        self._takes_bus_off = takes_bus_off
        self._is_fifo = is_fifo
        self._conditions = conditions
        self._wall_clock = WallClock()
        self.channels: dict[str, Channel] = {}
        self._lateness = DurationStatistics()

    @property
    def lateness(self) -> DurationSummary:
        """How long after an end of frame the broker came to deliver it: its wake-ups and stalls."""
        return self._lateness.summary()

    def run(self, ends: Sequence[int] = ()) -> None:
        """Serve until one of the descriptors ``ends`` is readable or closed."""
        try:
            while self.serve(self._timeout_s(), ends):
                pass
        finally:
            self.clients.close()

    def serve(self, timeout_s: float | None, ends: Sequence[int] = ()) -> bool:
        """Wait at most ``timeout_s`` for something to do, and do it; returns False at the end."""
        now_ns = self._clock_ns()
        clients = self.clients
        sources = [*clients.sources(now_ns), *ends]
        readable, writable, _ = select.select(sources, clients.writers, (), timeout_s)
        now_ns = self._clock_ns()
        # First what has been complete until now: what is read below competes only from now on.
        for channel in self.channels.values():
            if channel.is_due(now_ns):
                self._deliver(channel, now_ns)
        for source in readable:
            if isinstance(source, int):
                return False
            if isinstance(source, socket.socket):
                if (refused := clients.accept(now_ns)) is not None:
                    others = clients.figures.connected - 1
                    self._refuse(refused, f"it has {others} clients already", now_ns)
            elif source in clients.readers:
                self._read(source, now_ns)
        for client in writable:
            if client in clients.writers:
                clients.flush(client, now_ns)
        clients.keep_times(now_ns)
        return True

    def _timeout_s(self) -> float | None:
        """Time until the next thing that comes by itself [s]; None with nothing under way."""
        next_ns = min(
            (channel.next_event_ns for channel in self.channels.values()), default=NEVER_NS
        )
        now_ns = self._clock_ns()
        next_ns = min(next_ns, self.clients.next_ns(now_ns))
        return None if next_ns == NEVER_NS else max(next_ns - now_ns, 0) / NS_PER_S

    def _deliver(self, channel: Channel, now_ns: int) -> None:
        """Send out the frames that are complete, and let their senders submit more."""
        self._wall_clock.update()
        completed = channel.advance(now_ns)
        if completed:
            self._lateness.record(now_ns - completed[0].end_ns)
        for delivery in completed:
            client = channel.queue(delivery, self._wall_clock.at(delivery.end_ns))
            if client is not None:
                self._journal.note(f"{client} is in bus-off: errors on the bus", now_ns)
        for client in channel.come_back(now_ns, self._wall_clock.at(now_ns)):
            self._journal.note(f"{client} is back from bus-off", now_ns)
        for member in tuple(channel.members.values()):
            if member.has_outgoing:
                self.clients.flush(member, now_ns)
            if member.is_held_back and member in self.clients:
                self._submit(member, now_ns)

    def _read(self, client: Connection, now_ns: int) -> None:
        try:
            client.read()
            if client.hello is None:
                hello = client.take_hello()
                if hello is None:
                    return
                self.clients.greeted(client)
                self._welcome(client, hello, now_ns)
        except ConnectionLostError as reason:
            self.clients.drop(client, reason.cause, str(reason), now_ns)
            return
        except ProtocolError as reason:
            self.clients.drop(client, Cause.GARBAGE, str(reason), now_ns)
            return
        if client in self.clients:
            self._submit(client, now_ns)

    def _welcome(self, client: Connection, hello: Hello, now_ns: int) -> None:
        """Let a client join the channel it asks for, or refuse it."""
        reason = self._obstacle(hello)
        if reason:
            self._refuse(client, reason, now_ns)
            return
        if hello.channel not in self.channels:
            # Each with errors of its own; those of the first are those of virtual time.
            seed = self._conditions.seed + _SEED_STEP * len(self.channels)
            conditions = self._conditions._replace(seed=seed)
            rates = self._bitrate_bit_s, self._data_bitrate_bit_s
            self.channels[hello.channel] = Channel(
                *rates, conditions, now_ns, is_fifo=self._is_fifo
            )
        self.channels[hello.channel].join(client)
        self._journal.join(str(client), now_ns)
        client.queue(self._answer("").pack())
        self.clients.flush(client, now_ns)

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

    def _answer(self, reason: str) -> Answer:
        data_bitrate_bit_s = self._data_bitrate_bit_s or 0
        return Answer(self._bitrate_bit_s, data_bitrate_bit_s, reason, self._takes_bus_off)

    def _refuse(self, client: Connection, reason: str, now_ns: int) -> None:
        """Report to a client why it cannot join, and close."""
        client.queue(self._answer(reason).pack())
        self.clients.flush(client, now_ns)
        self.clients.drop(client, Cause.REFUSED, f"refused: {reason}", now_ns)

    def _submit(self, client: Connection, now_ns: int) -> None:
        """Put the frames a client has sent on its bus, as many as may wait there.

        The client is read again only when all are taken; that bounds what waits here for it.
        """
        if client.hello is None:
            return
        try:
            has_all = self.channels[client.hello.channel].submit(client, now_ns)
        except ProtocolError as reason:
            self.clients.drop(client, Cause.GARBAGE, str(reason), now_ns)
            return
        requests = client.take_bus_offs()
        for request in requests:
            self._send_off(client, request, now_ns)
        if client.has_outgoing:
            self.clients.flush(client, now_ns)
        if client not in self.clients:
            return
        changes = client.take_filter_changes() + len(requests)
        if not has_all:
            self.clients.hold_back(client)
        elif changes:
            self.clients.read_on(client, now_ns + changes * FILTER_CHANGE_NS)
        else:
            self.clients.read_on(client)

    def _send_off(self, asking: Connection, request: BusOff, now_ns: int) -> None:
        """Do what a client has asked for, if that is allowed here."""
        if not self._takes_bus_off:
            detail = "it requests a bus-off, which this bus does not allow"
            self.clients.drop(asking, Cause.REFUSED, detail, now_ns)
            return
        if asking.hello is None or asking not in self.clients:
            return
        self._wall_clock.update()
        channel = self.channels[asking.hello.channel]
        client = channel.go_off(request, now_ns, self._wall_clock.at(now_ns))
        if client is not None:
            self._journal.note(f"{client} is in bus-off: requested by {asking}", now_ns)
            self.clients.flush(client, now_ns)

    def _leave(self, client: Connection) -> None:
        if client.hello is not None and client.hello.channel in self.channels:
            self.channels[client.hello.channel].leave(client)
