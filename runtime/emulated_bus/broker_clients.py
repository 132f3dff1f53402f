"""The broker's clients: who is connected, whom it reads and writes, and by when."""

import select
import socket
from collections.abc import Callable, Iterator
from typing import NamedTuple

from ..node import NEVER_NS, NS_PER_MS, NS_PER_S
from .broker_connection import Connection, ConnectionLostError
from .journal import Cause, Journal

CLIENTS_MAX = 200
"""More would come near the 1024 descriptors that ``select`` can wait for."""
HELLO_TIMEOUT_NS = 5 * NS_PER_S
"""A client sends its hello within a millisecond of its connection."""
ACCEPT_PAUSE_NS = 100 * NS_PER_MS
"""How long nobody is accepted after the host had no descriptor for one."""
_DESCRIPTORS_MAX = 1024
"""FD_SETSIZE of select(2)."""


class ClientFigures(NamedTuple):
    """What the broker has had to do with its clients.

    ``connected``  now; ``most`` at once; ``served`` since the start
    ``held_back``  how often one was not read on because its transmit buffers were full
    """

    connected: int
    most: int
    served: int
    held_back: int


class Clients:
    """The connections that ``listener`` has taken.

    ``journal``  reports who goes
    ``leave``    called with a client that goes

    ``readers``, ``writers``, ``listener``  whom to wait for
    """

    def __init__(
        self, listener: socket.socket, journal: Journal, leave: Callable[[Connection], None]
    ) -> None:
        listener.setblocking(False)
        self.listener = listener
        self._journal = journal
        self._leave = leave
        self._all: set[Connection] = set()
        self.readers: set[Connection] = set()
        self.writers: set[Connection] = set()
        # By when something has to happen [ns], the earliest first where all wait equally long.
        self._greeted_by_ns: dict[Connection, int] = {}
        self._read_again_ns: dict[Connection, int] = {}
        self._accept_again_ns = self._most = self._served = self._held_back = 0

    def __iter__(self) -> Iterator[Connection]:
        return iter(self._all)

    def __contains__(self, client: Connection) -> bool:
        return client in self._all

    @property
    def figures(self) -> ClientFigures:
        """What clients have done so far."""
        return ClientFigures(len(self._all), self._most, self._served, self._held_back)

    def next_ns(self, now_ns: int) -> int:
        """When something is to be done to a client, or one to be accepted, by itself [ns]."""
        next_ns = self._accept_again_ns if self._accept_again_ns > now_ns else NEVER_NS
        return min([next_ns, *self._greeted_by_ns.values(), *self._read_again_ns.values()])

    def sources(self, now_ns: int) -> list[int | socket.socket | Connection]:
        """Return what to wait for: who may be read, and the listener."""
        listeners = [self.listener] if now_ns >= self._accept_again_ns else []
        return [*self.readers, *listeners]

    def accept(self, now_ns: int) -> Connection | None:
        """Take a new client; returns it if there is no place for it."""
        try:
            connection, _ = self.listener.accept()
        except (BlockingIOError, ConnectionError):
            return None  # it has gone again before it was taken
        except OSError:
            # No descriptor is left, or no memory: it goes on waiting, and would wake us at once.
            self._accept_again_ns = now_ns + ACCEPT_PAUSE_NS
            return None
        if connection.family == socket.AF_INET:
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._served += 1
        client = Connection(connection, self._served)
        self._all.add(client)
        if len(self._all) > CLIENTS_MAX:
            self._drop_dead(now_ns)
        if len(self._all) > CLIENTS_MAX or client.fileno() >= _DESCRIPTORS_MAX:
            return client
        self._most = max(self._most, len(self._all))
        self.readers.add(client)
        self._greeted_by_ns[client] = now_ns + HELLO_TIMEOUT_NS
        return None

    def greeted(self, client: Connection) -> None:
        """Note that a client has said hello."""
        del self._greeted_by_ns[client]

    def hold_back(self, client: Connection) -> None:
        """Read a client no further until its frames have gone out."""
        self._held_back += not client.is_held_back
        client.is_held_back = True
        self.readers.discard(client)

    def read_on(self, client: Connection, from_ns: int | None = None) -> None:
        """Read a client again, from ``from_ns`` on."""
        client.is_held_back = False
        if from_ns is not None:
            self.readers.discard(client)
            self._read_again_ns[client] = from_ns
        elif client not in self._read_again_ns:
            self.readers.add(client)

    def keep_times(self, now_ns: int) -> None:
        """Do what is to be done to clients at certain times."""
        if self._greeted_by_ns:
            late = [client for client, by_ns in self._greeted_by_ns.items() if by_ns <= now_ns]
            for client in late:
                waited = f"no hello for {HELLO_TIMEOUT_NS / NS_PER_S:g} s"
                self.drop(client, Cause.NO_HELLO, waited, now_ns)
        if self._read_again_ns:
            due = [client for client, at_ns in self._read_again_ns.items() if at_ns <= now_ns]
            for client in due:
                del self._read_again_ns[client]
                self.readers.add(client)

    def flush(self, client: Connection, now_ns: int) -> None:
        """Write what waits for a client, and come back when its socket takes more."""
        try:
            client.flush()
        except ConnectionLostError as reason:
            self.drop(client, reason.cause, str(reason), now_ns)
            return
        (self.writers.add if client.has_outgoing else self.writers.discard)(client)

    def drop(self, client: Connection, cause: Cause, detail: str, now_ns: int) -> None:
        """Forget a client; what it has submitted still goes out."""
        if client not in self._all:
            return
        self._journal.leave(str(client), cause, detail, now_ns)
        self._all.discard(client)
        self.readers.discard(client)
        self.writers.discard(client)
        self._greeted_by_ns.pop(client, None)
        self._read_again_ns.pop(client, None)
        self._leave(client)
        client.close()

    def close(self) -> None:
        """Close all connections."""
        for client in self._all:
            client.close()

    def _drop_dead(self, now_ns: int) -> None:
        """Make room: who is held back is not read, and so not seen to have hung up."""
        if not hasattr(select, "poll"):
            return
        poll = select.poll()
        held = {client.fileno(): client for client in self._all if client.is_held_back}
        for descriptor in held:
            poll.register(descriptor, 0)  # a hang-up is reported whatever is requested
        for descriptor, _ in poll.poll(0):
            self.drop(held[descriptor], Cause.LOST, "it has gone while its frames waited", now_ns)
