"""python-can's interface ``emulated``: one client of a broker.

    can.Bus(interface="emulated", channel="can0")

Errors are python-can's own: CanInitializationError when no broker listens or it refuses,
CanOperationError from ``recv`` and ``send`` when it has ended.
"""

import select
import socket
import threading
import time
from contextlib import suppress

import can
from can.bus import CanProtocol
from can.typechecking import AutoDetectedConfig, CanFilters, Channel

from ..frame import Frame
from ..frame.length_with_stuff_bits import frame_bits, padded_length
from ..frame.message import frame_of, message_of
from .address import AddressError, connect, default_address, parse_address
from .protocol import (
    ANSWER,
    Answer,
    Hello,
    ProtocolError,
    pack_frame,
    record_bytes,
    unpack_answer,
    unpack_frame,
)

DEFAULT_CHANNEL = "can0"

ANSWER_TIMEOUT_S = 5.0
"""A broker answers within a millisecond, unless it is stopped or is another program."""
_SEND_BUFFER_BYTES = 4608
"""Size of the socket's buffer: a dozen frames, as the transmit queue of a network interface. The
default size would hold hundreds, which would be old when they are sent."""
_DRAIN_TIMEOUT_S = 5.0
"""Time for the broker to read what was sent before ``shutdown``: far more than the frames in the
socket's buffer take on the wire."""


class EmulatedBus(can.BusABC):
    """A client on one channel of an emulated bus.

    ``channel``               any name; clients with the same one share a bus
    ``address``               where the broker listens, as its ``--address``; its default if None
    ``receive_own_messages``  also receive what this client sends, at its end of frame
    ``fd``                    send and receive CAN FD frames; the broker has to carry them
    ``bitrate``               the required bit rate [bit/s]; None: any
    ``data_bitrate``          the required bit rate of the data phase of CAN FD [bit/s]; None: any

    Options for other interfaces in python-can's configuration are ignored, as in all interfaces.

    Raises can.CanInitializationError in one line when the bus cannot be joined.
    """

    def __init__(
        self,
        channel: Channel = DEFAULT_CHANNEL,
        can_filters: CanFilters | None = None,
        address: str | None = None,
        receive_own_messages: bool = False,
        fd: bool = False,
        bitrate: int | None = None,
        data_bitrate: int | None = None,
        **_of_other_interfaces: object,
    ) -> None:
        hello = Hello(str(channel), fd, receive_own_messages, bitrate or 0, data_bitrate or 0)
        self._socket, answer = join(hello, address)
        self._channel = hello.channel
        self._record_bytes = record_bytes(fd)
        self._partial = b""
        # send_periodic sends from another thread.
        self._send_lock = threading.Lock()
        self._can_protocol = CanProtocol.CAN_FD if fd else CanProtocol.CAN_20
        self.channel_info = f"emulated bus, channel {hello.channel}, {answer.bitrate_bit_s} bit/s"
        super().__init__(channel, can_filters)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame; returns before it is on the wire.

        ``timeout``  how long to wait for room [s]; None: without limit, 0: not at all

        Raises can.CanTimeoutError without room in time, can.CanOperationError when the broker has
        ended, for an error frame, and for a CAN FD frame without ``fd``.
        """
        if msg.is_fd and self._can_protocol is not CanProtocol.CAN_FD:
            raise can.CanOperationError("a CAN FD frame needs a bus that was opened with fd=True")
        raw = pack_frame(self._record_bytes, _sent_frame(msg))
        with self._send_lock:
            self._send_all(raw, timeout)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        """Receive one frame, which python-can is still to filter."""
        raw = self._next_record(timeout)
        if raw is None:
            return None, False
        try:
            frame, time_ns = unpack_frame(raw)
        except ProtocolError as error:
            raise can.CanOperationError(str(error)) from error
        return _received_message(frame, time_ns, self._channel), False

    def _next_record(self, timeout: float | None) -> bytes | None:
        try:
            # Without waiting, one system call is enough.
            waits = timeout is None or timeout > 0
            if waits and not select.select([self._socket], [], [], timeout)[0]:
                return None
            received = self._socket.recv(self._record_bytes - len(self._partial))
        except BlockingIOError:
            return None
        except (OSError, ValueError) as error:
            raise self._lost(error) from error
        if not received:
            raise self._lost(None)
        self._partial += received
        if len(self._partial) < self._record_bytes:
            return None
        raw, self._partial = self._partial, b""
        return raw

    def _send_all(self, raw: bytes, timeout: float | None) -> None:
        """Write ``raw`` whole or not at all."""
        deadline_s = None if timeout is None else time.monotonic() + timeout
        remaining = memoryview(raw)
        while remaining:
            try:
                remaining = remaining[self._socket.send(remaining) :]
                # A partial record would garble the next one, so it is completed.
                deadline_s = None
            except BlockingIOError:
                wait_s = None if deadline_s is None else deadline_s - time.monotonic()
                if wait_s is not None and wait_s <= 0:
                    raise can.CanTimeoutError("no room to send: the bus is overloaded") from None
                select.select([], [self._socket], [], wait_s)
            except (OSError, ValueError) as error:
                raise self._lost(error) from error

    def _lost(self, error: Exception | None) -> can.CanOperationError:
        """Return the error to raise when the connection is lost."""
        if self._is_shutdown:
            return can.CanOperationError("this bus is shut down")
        cause = f" ({error})" if error else ""
        return can.CanOperationError(
            f"the emulated bus has closed the connection{cause}: its broker has ended, or this "
            "client has not read for too long"
        )

    def fileno(self) -> int:
        """Descriptor that is readable when a frame waits."""
        return self._socket.fileno()

    def shutdown(self) -> None:
        """Leave the bus. Frames sent before still go out."""
        was_open = not self._is_shutdown
        super().shutdown()
        if not was_open:
            return
        # The broker closes its side after it has read everything. Closing first could discard data.
        with suppress(OSError):
            self._socket.shutdown(socket.SHUT_WR)
            self._socket.settimeout(_DRAIN_TIMEOUT_S)
            while self._socket.recv(1 << 16):
                pass
        self._socket.close()

    @staticmethod
    def _detect_available_configs() -> list[AutoDetectedConfig]:
        """The default channel, when a broker listens at the default address."""
        try:
            connect(default_address(), ANSWER_TIMEOUT_S).close()
        except (OSError, AddressError):
            return []
        return [{"interface": "emulated", "channel": DEFAULT_CHANNEL}]


def join(hello: Hello, address_text: str | None) -> tuple[socket.socket, Answer]:
    """Connect and say hello; returns the non-blocking socket and the broker's answer.

    Raises can.CanInitializationError.
    """
    try:
        address = default_address() if address_text is None else parse_address(address_text)
        raw = hello.pack()
    except (AddressError, ProtocolError) as error:
        raise can.CanInitializationError(str(error)) from error
    option = f" --address {address}" if address_text else ""
    try:
        connection = connect(address, ANSWER_TIMEOUT_S)
    except OSError as error:
        raise can.CanInitializationError(
            f"no emulated bus is listening at {address} ({error.strerror or error}); "
            f"start one with: steer-by-wire bus{option}"
        ) from error
    try:
        # A full broker answers with the reason and closes before it reads anything.
        with suppress(BrokenPipeError):
            connection.sendall(raw)
        answer = unpack_answer(_receive_exactly(connection, ANSWER.size))
        if answer.reason:
            raise ProtocolError(answer.reason)
    except (OSError, ProtocolError) as error:
        connection.close()
        raise can.CanInitializationError(
            f"the emulated bus at {address} cannot be joined: {error}"
        ) from error
    connection.setblocking(False)
    if connection.family != socket.AF_INET:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER_BYTES)
    return connection, answer


def _receive_exactly(connection: socket.socket, size: int) -> bytes:
    received = b""
    while len(received) < size:
        part = connection.recv(size - len(received))
        if not part:
            raise ProtocolError("it has closed the connection")
        received += part
    return received


def _sent_frame(message: can.Message) -> Frame:
    """Return the frame to send, padded to a length that CAN FD has.

    Raises can.CanOperationError for an invalid frame.
    """
    frame = frame_of(message)
    if message.is_fd:
        # As SocketCAN does: CAN FD has no frame of nine bytes.
        size = padded_length(len(frame.data)) or 0
        frame = frame._replace(data=frame.data.ljust(size, b"\0"))
    try:
        frame_bits(frame)
    except ValueError as error:
        raise can.CanOperationError(str(error)) from error
    return frame


def _received_message(frame: Frame, time_ns: int, channel: str) -> can.Message:
    message = message_of(frame)
    message.timestamp = time_ns * 1e-9
    message.channel = channel
    return message
