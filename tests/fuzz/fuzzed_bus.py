"""A broker on a bus with two orderly clients, driven turn by turn for the fuzzer."""

import socket
from contextlib import ExitStack, suppress

from steer_by_wire.runtime.emulated_bus import protocol
from steer_by_wire.runtime.emulated_bus.broker import CLIENTS_MAX
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.frame.length_with_stuff_bits import frame_bits
from steer_by_wire.runtime.node import NS_PER_MS
from tests.support.programs.broker_bench import Bench, send

CHANNEL = "can0"
DATA_BITRATE_BIT_S = 2_000_000
_TURNS_MAX = 20_000
"""Turns of the broker by which every frame must have arrived."""


class FuzzedBus:
    """A broker in simulated time, and two orderly clients of it."""

    def __init__(self) -> None:
        self._stack = ExitStack()
        self._bench = Bench(self._stack, data_bitrate_bit_s=DATA_BITRATE_BIT_S)
        self._said: list[Frame] = []
        self._received: list[Frame] = []
        self._raw = b""
        self._speaker, self._listener = self._bench.join(CHANNEL), self._bench.join(CHANNEL)

    def __enter__(self) -> "FuzzedBus":
        return self

    def __exit__(self, *exception: object) -> None:
        self._stack.close()

    def connect(self) -> socket.socket:
        """Return a new connection to the broker."""
        return self._bench.connect()

    def turn(self, elapsed_ns: int) -> None:
        """Let the broker process what is pending."""
        self._bench.now_ns += elapsed_ns
        broker = self._bench.broker
        assert broker.serve(0.0), "the broker has ended"
        assert len(broker.clients) <= CLIENTS_MAX, "too many clients"
        self._listen()

    def say(self) -> None:
        """Let the orderly client send one frame, identified by its number.

        All have one identifier: others may overtake each other in the arbitration.
        """
        frame = Frame(0x700, len(self._said).to_bytes(4))
        send(self._speaker, frame)
        self._said.append(frame)

    def finish(self) -> None:
        """Let the bus come to rest; every frame sent must have been received."""
        for _ in range(_TURNS_MAX):
            if self._received == self._said:
                return
            self.turn(NS_PER_MS // 4)
        raise AssertionError(f"said {len(self._said)} frames, received {len(self._received)}")

    def _listen(self) -> None:
        with suppress(BlockingIOError):
            assert self._speaker.recv(1 << 16), "the broker has dropped the sender"
        with suppress(BlockingIOError):
            received = self._listener.recv(1 << 16)
            assert received, "the broker has dropped the receiver"
            self._raw += received
        size = protocol.CLASSIC_BYTES
        while len(self._raw) >= size:
            frame, _ = protocol.unpack_frame(self._raw[:size])
            self._raw = self._raw[size:]
            frame_bits(frame)
            if self._is_ours(frame):
                self._received.append(frame)

    def _is_ours(self, frame: Frame) -> bool:
        """Whether it is our next frame; an intruder may send the same, but never before us."""
        place = len(self._received)
        return place < len(self._said) and frame == self._said[place]
