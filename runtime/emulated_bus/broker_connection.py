"""The broker's connection to one client: bytes in and out, both bounded, without waiting."""

import socket
import struct
import sys
from enum import StrEnum

from ..frame import FD, Frame
from .protocol import HELLO, Hello, record_bytes, unpack_frame, unpack_hello

OUTGOING_BYTES_MAX = 1 << 20
"""Limit of the data that waits for a client: 43 690 classic frames, 10 s of a full bus at
500 kbit/s."""

FRAMES_WAITING_MAX = 64
"""Frames that wait for the bus when a client is read no further; the rest waits in its socket, as
in the queue of a network interface."""

READ_BYTES = 1 << 12
"""Small, because what is read but not submitted yet already counts as sent for the client."""
_PEER = struct.Struct("3i")
"""struct ucred of unix(7): process, user, group."""


class Cause(StrEnum):
    """Why a client has left."""

    LEFT = "left"
    """An orderly end; printed only on request."""
    LOST = "lost"
    """Its connection broke, or ended in the middle of a record."""
    REFUSED = "refused"
    """It required another bus, or there were too many clients."""
    GARBAGE = "garbage"
    """It violated the protocol, or sent a frame that no CAN controller can send."""
    NOT_READING = "not_reading"
    """Too much data waited for it."""


class ConnectionLostError(Exception):
    """The client has left or must be disconnected; the text is empty for an orderly end."""

    def __init__(self, cause: Cause, detail: str = "") -> None:
        super().__init__(detail)
        self.cause = cause


class Connection:
    """The connection to one client.

    ``hello``           its request; None until it is complete
    ``record_bytes``    size of the records of both sides after the hello
    ``waiting``         how many of its submitted frames are not complete yet
    ``is_held_back``    whether it is not read because too many of its frames wait
    """

    def __init__(self, connection: socket.socket, number: int) -> None:
        connection.setblocking(False)
        self.number = number
        self.hello: Hello | None = None
        self.waiting = 0
        self.is_held_back = False
        self._process = _process_of(connection)
        self._socket = connection
        self.record_bytes = record_bytes(fd=False)
        self._incoming, self._outgoing = bytearray(), bytearray()

    def __str__(self) -> str:
        of = f" of {self.hello.channel!r}" if self.hello else ""
        return f"client {self.number}{of}{self._process}"

    @property
    def has_outgoing(self) -> bool:
        """Whether bytes wait to be written."""
        return bool(self._outgoing)

    def fileno(self) -> int:
        """Descriptor to wait on."""
        return self._socket.fileno()

    def close(self) -> None:
        """Close the socket; unwritten data is lost."""
        self._socket.close()

    def read(self) -> None:
        """Read what the client has sent; raises ConnectionLostError at its end."""
        try:
            received = self._socket.recv(READ_BYTES)
        except BlockingIOError:
            return
        except OSError as error:
            raise ConnectionLostError(Cause.LOST, str(error)) from error
        if not received and self._incoming:
            raise ConnectionLostError(Cause.LOST, "it ends in the middle of a record")
        if not received:
            raise ConnectionLostError(Cause.LEFT)
        self._incoming += received

    def read_hello(self) -> Hello | None:
        """Remove the hello from the input if it is complete; raises ProtocolError."""
        if len(self._incoming) < HELLO.size:
            return None
        self.hello = unpack_hello(self._remove(HELLO.size))
        self.record_bytes = record_bytes(self.hello.fd)
        return self.hello

    def next_frame(self) -> Frame | None:
        """Remove the next frame from the input; None if there is none. Raises ProtocolError."""
        if len(self._incoming) < self.record_bytes:
            return None
        frame, _ = unpack_frame(self._remove(self.record_bytes))
        return frame

    def wants(self, frame: Frame, sender: int) -> bool:
        """Whether the client receives ``frame`` of client ``sender``."""
        if self.hello is None or (sender == self.number and not self.hello.receive_own):
            return False
        return self.hello.fd or not frame.flags & FD

    def queue(self, raw: bytes) -> None:
        """Add bytes to be written by the next ``flush``."""
        self._outgoing += raw

    def flush(self) -> None:
        """Write as much as the socket takes now.

        Raises ConnectionLostError if the client has left or too much data waits for it.
        """
        try:
            written = self._socket.send(self._outgoing)
        except BlockingIOError:
            written = 0
        except OSError as error:
            raise ConnectionLostError(Cause.LOST, str(error)) from error
        del self._outgoing[:written]
        if len(self._outgoing) > OUTGOING_BYTES_MAX:
            raise ConnectionLostError(
                Cause.NOT_READING, f"it does not read: {len(self._outgoing)} bytes wait for it"
            )

    def _remove(self, size: int) -> bytes:
        taken = bytes(self._incoming[:size])
        del self._incoming[:size]
        return taken


def _process_of(connection: socket.socket) -> str:
    if sys.platform != "linux" or connection.family != socket.AF_UNIX:
        return ""
    peer = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _PEER.size)
    return f" (process {_PEER.unpack(peer)[0]})"
