"""The emulated bus: its time on the wire, and how it treats good and bad clients.

Brokers run as processes of their own. Times are asserted on the time stamps, which come from the
bus model and do not depend on how fast this machine is.
"""

import asyncio
import socket
import uuid
from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any

import can
import pytest

from steer_by_wire.closed_loop.processes.process_group import launched_broker
from steer_by_wire.runtime.bus_model.bus_model import BusModel
from steer_by_wire.runtime.emulated_bus.protocol import ANSWER, CLASSIC_BYTES, Hello, pack_frame
from steer_by_wire.runtime.frame import EXTENDED, REMOTE, Frame
from tests.support.programs.broker_program import client, message, receive
from tests.support.programs.broker_program import stack as stack
from tests.support.programs.running_program import PATIENCE_S

STAMP_RESOLUTION_S = 1e-6
"""python-can's time stamps are floats: a quarter of a microsecond in this century."""


@pytest.fixture(scope="module")
def classic_address() -> Iterator[str]:
    with launched_broker() as address:
        yield address


@pytest.fixture(scope="module")
def fd_address() -> Iterator[str]:
    with launched_broker(["--bitrate", "1000000", "--data-bitrate", "8000000"]) as address:
        yield address


def raw_client(stack: ExitStack, address: str, hello: Hello) -> socket.socket:
    """A client that may misbehave: its socket, after the broker's welcome."""
    connection = stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
    connection.settimeout(PATIENCE_S)
    connection.connect(address)
    connection.sendall(hello.pack())
    assert len(connection.recv(ANSWER.size, socket.MSG_WAITALL)) == ANSWER.size
    return connection


# Time on the wire


def test_frames_go_out_by_identifier_and_take_their_exact_time(
    stack: ExitStack, classic_address: str
) -> None:
    channel = uuid.uuid4().hex
    listener = client(stack, classic_address, channel=channel)
    sender = raw_client(stack, classic_address, Hello(channel))
    sent = [
        Frame(0x300, b"\xff" * 8),
        Frame(0x100 << 18, b"\x55" * 8, EXTENDED),
        Frame(0x100, b"\x00" * 8),
        Frame(0x100, b"", REMOTE),
        Frame(0x200, b"a"),
    ]
    # One write is one read of the broker: all of them compete at the same instant.
    sender.sendall(b"".join(pack_frame(CLASSIC_BYTES, frame) for frame in sent))
    received = [receive(listener) for _ in sent]

    model = BusModel(500_000)
    for frame in sent:
        model.submit([frame], 0, 0)
    expected = model.advance(1_000_000_000)
    assert [seen.arbitration_id for seen in received] == [frame.can_id for _, _, frame in expected]
    for seen, done in zip(received, expected, strict=True):
        elapsed_s = seen.timestamp - received[0].timestamp
        assert elapsed_s == pytest.approx((done[0] - expected[0][0]) * 1e-9, abs=STAMP_RESOLUTION_S)


def test_channels_are_buses_of_their_own(stack: ExitStack, classic_address: str) -> None:
    one, other = uuid.uuid4().hex, uuid.uuid4().hex
    sender, outsider = (client(stack, classic_address, channel=name) for name in (one, other))
    insider = client(stack, classic_address, channel=one)
    sender.send(message(1))
    assert receive(insider).arbitration_id == 1
    client(stack, classic_address, channel=other).send(message(2))
    assert receive(outsider).arbitration_id == 2


# Clients


def test_classic_clients_do_not_see_fd_frames_and_do_not_send_them(
    stack: ExitStack, fd_address: str
) -> None:
    channel = uuid.uuid4().hex
    fd_client = client(stack, fd_address, channel=channel, fd=True)
    classic = client(stack, fd_address, channel=channel)
    fd_client.send(can.Message(is_fd=True, data=bytes(20)))
    fd_client.send(message(2))
    assert receive(classic).arbitration_id == 2
    with pytest.raises(can.CanOperationError, match="fd=True"):
        classic.send(can.Message(is_fd=True))


def test_fd_frames_are_filled_up_to_a_length_that_exists(stack: ExitStack, fd_address: str) -> None:
    channel = uuid.uuid4().hex
    one, other = (client(stack, fd_address, channel=channel, fd=True) for _ in range(2))
    one.send(can.Message(is_fd=True, data=b"123456789"))
    assert receive(other).data == b"123456789\0\0\0"


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({"fd": True}, "classic frames only.*--data-bitrate"),
        ({"bitrate": 250_000}, "runs at 500000 bit/s, not at 250000"),
        ({"channel": "x" * 65}, "channel name"),
        ({"channel": "a\0b"}, "channel name"),
    ],
)
def test_a_client_that_does_not_fit_is_refused_with_the_reason(
    stack: ExitStack, classic_address: str, options: dict[str, Any], reason: str
) -> None:
    with pytest.raises(can.CanInitializationError, match=reason):
        client(stack, classic_address, **options)


@pytest.mark.parametrize(
    "wrong",
    [
        can.Message(is_error_frame=True),
        can.Message(arbitration_id=0x800, is_extended_id=False),
        can.Message(arbitration_id=1 << 29),
        can.Message(arbitration_id=-1),
        can.Message(data=bytes(9)),
        can.Message(bitrate_switch=True),
    ],
    ids=str,
)
def test_what_no_controller_can_send_is_refused_when_it_is_sent(
    stack: ExitStack, classic_address: str, wrong: can.Message
) -> None:
    bus = client(stack, classic_address, channel=uuid.uuid4().hex)
    with pytest.raises(can.CanOperationError, match="frame"):
        bus.send(wrong)


def test_every_frame_of_a_burst_reaches_an_asyncio_notifier(
    stack: ExitStack, classic_address: str
) -> None:
    """python-can reads one frame each time the descriptor is readable, and no more."""
    channel = uuid.uuid4().hex
    one, other = (client(stack, classic_address, channel=channel) for _ in range(2))
    for number in range(100):
        one.send(message(number))

    async def collect() -> list[int]:
        reader = can.AsyncBufferedReader()
        with can.Notifier(other, [reader], loop=asyncio.get_running_loop()):
            return [
                (await asyncio.wait_for(reader.get_message(), PATIENCE_S)).arbitration_id
                for _ in range(100)
            ]

    assert sorted(asyncio.run(collect())) == list(range(100))
