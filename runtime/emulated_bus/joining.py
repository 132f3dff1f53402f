"""How a client joins a broker: connect, say hello, read the answer."""

import socket
from contextlib import suppress

import can

from .address import AddressError, connect, default_address, parse_address
from .protocol import ANSWER, Answer, Hello, ProtocolError, unpack_answer

ANSWER_TIMEOUT_S = 5.0
"""A broker answers within a millisecond, unless it is stopped or is another program."""
_SEND_BUFFER_BYTES = 4608
"""Size of the socket's buffer: a dozen frames, as the transmit queue of a network interface. The
default size would hold hundreds, which would be old when they are sent."""


def join(hello: Hello, address_text: str | None) -> tuple[socket.socket, Answer]:
    """Connect and say hello; returns the non-blocking socket and the broker's answer.

    Raises can.CanInitializationError.
    """
    try:
        address = parse_address(address_text) if address_text else default_address()
        raw = hello.pack()
    except (AddressError, ProtocolError) as error:
        raise can.CanInitializationError(str(error)) from error
    option = f" --address {address}" if address_text else ""
    try:
        connection = connect(address, ANSWER_TIMEOUT_S)
    except OSError as error:
        raise can.CanInitializationError(
            f"no emulated bus is listening at {address} ({error.strerror or error}); "
            f"start one with: emulated-can-bus{option}"
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
    """Receive ``size`` bytes; raises OSError or ProtocolError."""
    received = b""
    while len(received) < size:
        part = connection.recv(size - len(received))
        if not part:
            raise ProtocolError("it has closed the connection")
        received += part
    return received
