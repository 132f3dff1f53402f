"""A client of the emulated bus that behaves badly, as fast as it can, until it is killed.

python -m tests.support.hostile_client KIND ADDRESS CHANNEL
"""

import socket
import sys
from collections.abc import Callable
from contextlib import suppress
from itertools import count
from typing import NoReturn

from steer_by_wire.runtime.emulated_bus.protocol import (
    ANSWER,
    CLASSIC_RECORD,
    Hello,
    pack_filters,
    pack_frame,
)
from steer_by_wire.runtime.frame import Frame

PATIENCE_S = 5.0
_BATCH = 100


def flood(connect: Callable[[], socket.socket]) -> None:
    """Send frames of low priority without end; receive all frames."""
    client = connect()
    client.sendall(pack_filters(CLASSIC_RECORD, []))
    _send_without_end(client, pack_frame(CLASSIC_RECORD, Frame(0x7F0, bytes(8))))


def stall(connect: Callable[[], socket.socket]) -> None:
    """Read nothing, until disconnected; then connect again."""
    while True:
        client = connect()
        while _is_open(client):
            pass
        client.close()


def garbage(connect: Callable[[], socket.socket]) -> None:
    """Send bytes without meaning; reconnect at once when disconnected."""
    for number in count():
        try:
            with connect() as client:
                client.sendall(bytes([4 + number % 252]) * CLASSIC_RECORD.size * 4)
                while client.recv(1 << 12):
                    pass
        except OSError:
            continue


def filters(connect: Callable[[], socket.socket]) -> None:
    """Change the filters without end."""
    _send_without_end(connect(), pack_filters(CLASSIC_RECORD, []))


def visits(connect: Callable[[], socket.socket]) -> None:
    """Connect, leave frames of low priority behind, and disconnect, without end."""
    batch = pack_frame(CLASSIC_RECORD, Frame(0x7F1, bytes(8))) * 60
    while True:
        try:
            with connect() as client:
                client.sendall(batch)
        except OSError:
            continue


KINDS = {kind.__name__: kind for kind in (flood, stall, garbage, filters, visits)}


def main() -> int:
    """Misbehave."""
    kind, address, channel = sys.argv[1:]

    def connect() -> socket.socket:
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        connection.settimeout(PATIENCE_S)
        connection.connect(address)
        connection.sendall(Hello(channel).pack())
        connection.recv(ANSWER.size)
        return connection

    sys.stdout.write("ready\n")
    sys.stdout.flush()
    KINDS[kind](connect)
    return 0


def _send_without_end(client: socket.socket, record: bytes) -> NoReturn:
    batch = record * _BATCH
    client.settimeout(None)
    while True:
        client.sendall(batch)
        with suppress(BlockingIOError):
            while client.recv(1 << 16, socket.MSG_DONTWAIT):
                pass


def _is_open(client: socket.socket) -> bool:
    """Send a frame now and then, to detect when the broker has closed the connection."""
    try:
        client.sendall(pack_frame(CLASSIC_RECORD, Frame(0x7F2, b"")))
    except TimeoutError:
        return True
    except OSError:
        return False
    return True


if __name__ == "__main__":
    sys.exit(main())
