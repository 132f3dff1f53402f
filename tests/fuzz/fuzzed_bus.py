"""A broker on a bus with two orderly clients, driven turn by turn for the fuzzer."""

import socket
from contextlib import ExitStack, suppress
from pathlib import Path
from tempfile import TemporaryDirectory

from steer_by_wire.runtime.emulated_bus import protocol
from steer_by_wire.runtime.emulated_bus.broker import Broker
from steer_by_wire.runtime.emulated_bus.broker_clients import CLIENTS_MAX
from steer_by_wire.runtime.emulated_bus.journal import Journal
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node import NS_PER_MS
from tests.fuzz.traffic import promise

CHANNEL = "can0"
BITRATE_BIT_S, DATA_BITRATE_BIT_S = 500_000, 2_000_000
_TURNS_MAX = 20_000
"""Turns of the broker by which every frame must have arrived."""


class FuzzedBus:
    """A broker in simulated time, and two orderly clients of it."""

    def __init__(self) -> None:
        self._stack = ExitStack()
        folder = self._stack.enter_context(TemporaryDirectory())
        listener, self.address = listening_socket(folder)
        self._stack.callback(listener.close)
        self._now_ns = 0
        self._broker = Broker(
            listener,
            BITRATE_BIT_S,
            DATA_BITRATE_BIT_S,
            Journal(lambda _line: True, is_verbose=True),
            lambda: self._now_ns,
        )
        self._stack.callback(self._end)
        self._said: list[Frame] = []
        self._received: list[Frame] = []
        self._raw = b""
        self._speaker, self._listener = self._join(), self._join()

    def __enter__(self) -> "FuzzedBus":
        return self

    def __exit__(self, *exception: object) -> None:
        self._stack.close()

    def connect(self) -> socket.socket:
        """Return a new connection to the broker."""
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._stack.callback(connection.close)
        connection.connect(self.address)
        connection.setblocking(False)
        self.turn(0)
        return connection

    def turn(self, elapsed_ns: int) -> None:
        """Let the broker process what is pending."""
        self._now_ns += elapsed_ns
        promise(self._broker.serve(0.0), "the broker has ended")
        promise(self._broker.clients.figures.connected <= CLIENTS_MAX, "too many clients")
        self._listen()

    def say(self) -> None:
        """Let the orderly client send one frame, identified by its number.

        All have one identifier: others may overtake each other in the arbitration.
        """
        frame = Frame(0x700, len(self._said).to_bytes(4))
        self._speaker.sendall(protocol.pack_frame(protocol.CLASSIC_RECORD, frame))
        self._said.append(frame)

    def finish(self) -> None:
        """Let the bus come to rest; every frame sent must have been received."""
        for _ in range(_TURNS_MAX):
            if self._received == self._said:
                return
            self.turn(NS_PER_MS // 4)
        promise(False, f"said {len(self._said)} frames, received {len(self._received)}")

    def _join(self) -> socket.socket:
        connection = self.connect()
        connection.sendall(protocol.Hello(CHANNEL).pack())
        self.turn(0)
        answer = protocol.unpack_answer(connection.recv(protocol.ANSWER.size))
        promise(not answer.reason, f"refused: {answer.reason}")
        return connection

    def _listen(self) -> None:
        if not hasattr(self, "_listener"):
            return
        with suppress(BlockingIOError):
            promise(bool(self._speaker.recv(1 << 16)), "the broker has dropped the sender")
        with suppress(BlockingIOError):
            received = self._listener.recv(1 << 16)
            promise(bool(received), "the broker has dropped the receiver")
            self._raw += received
        record = protocol.CLASSIC_RECORD
        while len(self._raw) >= record.size:
            frame, _ = protocol.unpack_delivery(record, self._raw[: record.size])
            self._raw = self._raw[record.size :]
            if not isinstance(frame, Frame):
                promise(False, f"a client that sends nothing receives {frame}")
                return
            protocol.check_frame(frame)
            if self._is_ours(frame):
                self._received.append(frame)

    def _is_ours(self, frame: Frame) -> bool:
        """Whether it is our next frame; an intruder may send the same, but never before us."""
        place = len(self._received)
        return place < len(self._said) and frame == self._said[place]

    def _end(self) -> None:
        one, other = socket.socketpair()
        other.close()  # which makes the first one readable: the broker ends
        with one:
            self._broker.run(one.fileno())


def listening_socket(folder: str) -> tuple[socket.socket, str]:
    """Return a socket that listens, and its address."""
    address = str(Path(folder) / "socket")
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    listener.bind(address)
    listener.listen(16)
    return listener, address
