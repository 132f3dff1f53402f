"""One client as the broker sees it: bytes in, bytes out, both bounded, never waiting."""

import socket
import struct
import sys

from ..frame import EXTENDED, FD, Frame
from .bus_off import Recovery
from .journal import Cause
from .protocol import (
    FILTERS_MAX,
    HELLO,
    BusOff,
    ClearFilters,
    Filter,
    Hello,
    ProtocolError,
    record_format,
    unpack_hello,
    unpack_request,
)

OUTGOING_BYTES_MAX = 1 << 20
"""What may wait for a client that does not read: 43 690 classic frames, 10 s of a full bus at
500 kbit/s."""

MASKS_MAX = 16
"""Different masks in the filters of one client that are looked up for every frame. With more the
client gets everything, as if the bus had no filters: 512 of them would take longer than a frame."""
READ_BYTES = 1 << 12
"""Few at a time: what has been read and is not on its way yet counts as taken for the client."""
_PEER = struct.Struct("3i")
"""struct ucred of unix(7): process, user, group."""


BufferKey = tuple[int, bool]
"""A transmit buffer: the identifier of its frames, and whether that has 29 bits."""


class ConnectionLostError(Exception):
    """The client is gone, or has to go; the text is empty for an orderly end."""

    def __init__(self, cause: Cause, detail: str = "") -> None:
        super().__init__(detail)
        self.cause = cause


class Connection:
    """The connection to one client.

    ``number``          names the client as a sender on its channel
    ``hello``           what it asked for; None until that has come in whole
    ``record``          the format of the records of both sides from then on
    ``waiting``         frames it has submitted that are not complete yet, by transmit buffer; the
                        broker counts here
    ``full``            transmit buffers that were reported to it as full
    ``is_held_back``    whether it is not read because as many frames wait as may
    ``is_behind``       whether its socket had no room for all when it was last written to
    ``recovery``        while its CAN controller is in bus-off: the way out
    """

    def __init__(self, connection: socket.socket, number: int) -> None:
        connection.setblocking(False)
        self.number = number
        self.hello: Hello | None = None
        self.waiting: dict[BufferKey, int] = {}
        self.full: set[BufferKey] = set()
        self.is_held_back = False
        self.is_behind = False
        self.recovery: Recovery | None = None
        self._process = _process_of(connection)
        self._socket = connection
        self.record = record_format(fd=False)
        self._incoming = bytearray()
        self._outgoing = bytearray()
        self._masks: dict[tuple[int, bool | None], set[int]] = {}
        self._filters = 0
        self._filter_changes = 0
        self._bus_offs: list[BusOff] = []
        self._put_back: Frame | None = None

    def __str__(self) -> str:
        of = f" of {self.hello.channel!r}" if self.hello else ""
        return f"client {self.number}{of}{self._process}"

    @property
    def frames_waiting(self) -> int:
        """Frames it has submitted that are not complete yet."""
        return sum(self.waiting.values())

    @property
    def has_outgoing(self) -> bool:
        """Whether bytes wait to be written."""
        return bool(self._outgoing)

    def fileno(self) -> int:
        """Descriptor to wait on."""
        return self._socket.fileno()

    def close(self) -> None:
        """Close the socket; what waits to be written is lost."""
        self._socket.close()

    def read(self) -> None:
        """Take in what the client has sent; raises ConnectionLostError at its end."""
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

    def take_hello(self) -> Hello | None:
        """Take the hello off what has come in, when it is whole; raises ProtocolError."""
        if len(self._incoming) < HELLO.size:
            return None
        self.hello = unpack_hello(self._take(HELLO.size))
        self.record = record_format(self.hello.fd)
        return self.hello

    def take_frame(self) -> Frame | None:
        """Take the next frame off what has come in, None without one; raises ProtocolError.

        Changes of the filters that lie before it take effect on the way; requests for bus-off are
        kept for ``take_bus_offs``.
        """
        if self._put_back is not None:
            frame, self._put_back = self._put_back, None
            return frame
        while len(self._incoming) >= self.record.size:
            request = unpack_request(self.record, self._take(self.record.size))
            if isinstance(request, Frame):
                return request
            if isinstance(request, BusOff):
                self._bus_offs.append(request)
            else:
                self._change_filters(request)
        return None

    def put_back(self, frame: Frame) -> None:
        """Have ``take_frame`` return ``frame`` again, for which there was no room."""
        self._put_back = frame

    def take_bus_offs(self) -> list[BusOff]:
        """Return the requests for bus-off that have been taken since the last call."""
        requests, self._bus_offs = self._bus_offs, []
        return requests

    def wants(self, frame: Frame, sender: int) -> bool:
        """Whether the client is to get ``frame`` of client ``sender``."""
        if self.hello is None or (sender == self.number and not self.hello.receive_own):
            return False
        if self.recovery is not None:
            return False
        if frame.flags & FD and not self.hello.fd:
            return False
        if not self._masks or len(self._masks) > MASKS_MAX:
            return True
        is_extended = bool(frame.flags & EXTENDED)
        for (mask, extended), can_ids in self._masks.items():
            if frame.can_id & mask in can_ids and extended in (None, is_extended):
                return True
        return False

    def take_filter_changes(self) -> int:
        """Return how many records that change filters have been taken since the last call."""
        changes, self._filter_changes = self._filter_changes, 0
        return changes

    def queue(self, raw: bytes) -> None:
        """Add bytes to be written by the next ``flush``."""
        self._outgoing += raw

    def flush(self) -> None:
        """Write what the socket takes now.

        Raises ConnectionLostError when the client is gone or too much waits for it.
        """
        try:
            written = self._socket.send(self._outgoing)
        except BlockingIOError:
            written = 0
        except OSError as error:
            raise ConnectionLostError(Cause.LOST, str(error)) from error
        del self._outgoing[:written]
        self.is_behind = bool(self._outgoing)
        if len(self._outgoing) > OUTGOING_BYTES_MAX:
            raise ConnectionLostError(
                Cause.NOT_READING, f"it does not read: {len(self._outgoing)} bytes wait for it"
            )

    def _take(self, size: int) -> bytes:
        """Remove and return the first ``size`` bytes that came in."""
        taken = bytes(self._incoming[:size])
        del self._incoming[:size]
        return taken

    def _change_filters(self, request: Filter | ClearFilters) -> None:
        """Add a filter or clear all; raises ProtocolError when there are too many."""
        self._filter_changes += 1
        if isinstance(request, ClearFilters):
            self._masks.clear()
            self._filters = 0
        elif self._filters < FILTERS_MAX:
            can_id, mask, extended = request
            self._masks.setdefault((mask, extended), set()).add(can_id & mask)
            self._filters += 1
        else:
            raise ProtocolError(f"more than {FILTERS_MAX} filters")


def _process_of(connection: socket.socket) -> str:
    """Name the process at the other end, which finds the culprit; empty where that is unknown."""
    if sys.platform != "linux" or connection.family != socket.AF_UNIX:
        return ""
    peer = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _PEER.size)
    return f" (process {_PEER.unpack(peer)[0]})"
