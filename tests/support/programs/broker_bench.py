"""A broker that a test steps by hand, with a fake clock and ordinary sockets."""

import socket
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from steer_by_wire.runtime.bus_model.rest_bus import NO_TRAFFIC, Traffic
from steer_by_wire.runtime.emulated_bus.address import listening
from steer_by_wire.runtime.emulated_bus.broker import Broker
from steer_by_wire.runtime.emulated_bus.broker_connection import Cause
from steer_by_wire.runtime.emulated_bus.protocol import (
    ANSWER,
    CLASSIC_BYTES,
    Hello,
    pack_frame,
    unpack_answer,
    unpack_frame,
)
from steer_by_wire.runtime.frame import Frame

BITRATE_BIT_S = 500_000
CLASSIC_FRAME_NS = 300_000
"""Longer than any classic frame at 500 kbit/s."""


class Bench:
    """A broker, its clock, its clients, and what it has reported."""

    def __init__(
        self, stack: ExitStack, traffic: Traffic = NO_TRAFFIC, data_bitrate_bit_s: int | None = None
    ) -> None:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="bus-")))
        self.path = folder / "socket"
        self._stack = stack
        listener = stack.enter_context(listening(self.path))
        self.now_ns = 0
        self.lines: list[str] = []
        self.broker = Broker(
            listener,
            BITRATE_BIT_S,
            data_bitrate_bit_s,
            self.lines.append,
            lambda: self.now_ns,
            traffic=traffic,
        )
        stack.callback(self._close)

    def _close(self) -> None:
        for client in self.broker.clients:
            client.close()

    def connect(self) -> socket.socket:
        """A connection that has sent nothing yet."""
        client = self._stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
        client.connect(str(self.path))
        client.setblocking(False)
        self.step()
        return client

    def join(self, channel: str = "can0") -> socket.socket:
        """A client on a channel."""
        client = self.connect()
        client.sendall(Hello(channel).pack())
        self.step()
        assert not unpack_answer(client.recv(ANSWER.size)).reason
        return client

    def step(self, times: int = 3) -> None:
        """Let the broker see what is there, at this instant."""
        for _ in range(times):
            assert self.broker.serve(0.0)

    def advance(self, duration_ns: int) -> None:
        """Let time pass, frame by frame."""
        end_ns = self.now_ns + duration_ns
        while self.now_ns < end_ns:
            self.now_ns = min(self.now_ns + CLASSIC_FRAME_NS, end_ns)
            self.step(1)

    def gone(self, cause: Cause) -> int:
        return self.broker.disconnections[cause]


@pytest.fixture
def bench() -> Iterator[Bench]:
    with ExitStack() as stack:
        yield Bench(stack)


def send(client: socket.socket, *frames: Frame) -> None:
    client.sendall(b"".join(pack_frame(CLASSIC_BYTES, frame) for frame in frames))


def received(client: socket.socket) -> list[Frame]:
    """Every frame that a client has been sent."""
    raw = b""
    while True:
        try:
            part = client.recv(1 << 16)
        except BlockingIOError:
            break
        if not part:
            break
        raw += part
    size = CLASSIC_BYTES
    return [unpack_frame(raw[start : start + size])[0] for start in range(0, len(raw), size)]


def assert_bus_is_well(bench: Bench, one: socket.socket, other: socket.socket) -> None:
    """A frame of the highest priority waits for the frame on the wire and for nothing else."""
    received(other)
    send(one, Frame(0, b"well"))
    bench.step()
    bench.advance(2 * CLASSIC_FRAME_NS)
    assert Frame(0, b"well") in received(other)
