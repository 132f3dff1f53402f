"""Promises of every bus to the nodes, tested on each available backend.

Nothing here depends on how fast the machine is: a frame that must not arrive is proven absent by
one that was sent after it.
"""

import random
import time
import uuid
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any

import can
import pytest

from steer_by_wire.closed_loop.processes.process_group import launched_broker
from steer_by_wire.runtime.frame.message import frame_of, message_of
from steer_by_wire.runtime.port.python_can import BusPort
from steer_by_wire.runtime.port.socketcan import SocketCanPort
from tests.support.programs.running_program import PATIENCE_S

OpenClient = Callable[..., can.BusABC]
FAST = pytest.param("fast_socketcan", marks=pytest.mark.vcan)
OF_PYTHON_CAN = (
    "emulated",
    "virtual",
    pytest.param("socketcan", marks=pytest.mark.vcan),
    "udp_multicast",
)


class FastBus(can.BusABC):
    """A SocketCanPort, spoken to as to every other bus here."""

    def __init__(self, channel: str, can_filters: Any = None, *, fd: bool = False) -> None:
        self._fast_port = SocketCanPort(channel, fd=fd)
        super().__init__(channel, can_filters=can_filters)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:  # noqa: ARG002
        assert self._fast_port.send(frame_of(msg))

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        received = self._fast_port.recv(PATIENCE_S if timeout is None else timeout)
        return (None if received is None else message_of(received.frame)), True

    def _apply_filters(self, filters: Any) -> None:
        self._fast_port.set_filters(filters)

    def shutdown(self) -> None:
        super().shutdown()
        self._fast_port.shutdown()


@pytest.fixture(scope="module")
def broker_address() -> Iterator[str]:
    with launched_broker(["--bitrate", "1000000", "--data-bitrate", "4000000"]) as address:
        yield address


def multicast_options() -> dict[str, Any]:
    """Of a group of its own for whoever asks, of those for private use; nothing leaves the host."""
    group = ".".join(str(random.SystemRandom().randrange(1, 255)) for _ in range(3))
    return {"channel": f"239.{group}", "hop_limit": 0, "fd": True}


@cache
def multicast_obstacle() -> str:
    """What keeps this machine from carrying multicast to itself; empty where it does."""
    options = multicast_options()
    try:
        with (
            can.Bus(interface="udp_multicast", ignore_config=True, **options) as one,
            can.Bus(interface="udp_multicast", ignore_config=True, **options) as other,
        ):
            one.send(frame(0))
            return "" if other.recv(PATIENCE_S) else "what is sent does not arrive"
    except (can.CanError, OSError) as error:
        return str(error)


@pytest.fixture(params=[*OF_PYTHON_CAN, FAST])
def open_client(request: pytest.FixtureRequest) -> Iterator[OpenClient]:
    """Opens one more client on a bus that is this test's own (vcan0 has to be quiet)."""
    interface: str = request.param
    if interface == "udp_multicast" and multicast_obstacle():
        pytest.skip(f"no multicast on this machine: {multicast_obstacle()}")
    channel = uuid.uuid4().hex
    options: dict[str, dict[str, Any]] = {
        "virtual": {"channel": channel, "protocol": can.CanProtocol.CAN_FD},
        "socketcan": {"channel": "vcan0", "fd": True},
        "fast_socketcan": {"channel": "vcan0", "fd": True},
        "udp_multicast": multicast_options(),
    }
    if interface == "emulated":  # the others need no broker
        address = request.getfixturevalue("broker_address")
        options["emulated"] = {"channel": channel, "address": address, "fd": True}
    opened: list[can.BusABC] = []

    def open_one(**more: Any) -> can.BusABC:
        given = {**options[interface], **more}
        if interface == "fast_socketcan":
            opened.append(FastBus(**given))
            return opened[-1]
        try:
            bus = can.Bus(interface=interface, ignore_config=True, **given)
        except can.CanInterfaceNotImplementedError as error:
            pytest.skip(f"{interface}: {error}")
        opened.append(bus)
        return bus

    yield open_one
    for bus in opened:
        bus.shutdown()


def frame(number: int, can_id: int = 0x5A0) -> can.Message:
    return can.Message(arbitration_id=can_id, data=number.to_bytes(4), is_extended_id=False)


def receive(bus: can.BusABC) -> can.Message:
    message = bus.recv(PATIENCE_S)
    assert message is not None, "a frame was lost"
    return message


def receive_numbers(bus: can.BusABC, count: int) -> list[int]:
    return [int.from_bytes(receive(bus).data) for _ in range(count)]


def test_frames_reach_every_other_client_in_order_and_exactly_once(open_client: OpenClient) -> None:
    sender, *receivers = [open_client() for _ in range(4)]
    for number in range(100):
        sender.send(frame(number))
    for receiver in receivers:
        assert receive_numbers(receiver, 100) == list(range(100))
    sender.send(frame(1000))
    for receiver in receivers:
        assert receive_numbers(receiver, 1) == [1000]


def test_no_port_receives_what_it_has_sent_itself(open_client: OpenClient) -> None:
    """Multicast brings it back: there the port drops it."""
    one, other = (
        bus._fast_port if isinstance(bus, FastBus) else BusPort(bus)
        for bus in (open_client(), open_client())
    )
    for number in range(3):
        assert one.send(frame_of(frame(number)))
        assert other.send(frame_of(frame(100 + number)))
    assert [received_by(one) for _ in range(3)] == [100, 101, 102]
    assert [received_by(other) for _ in range(3)] == [0, 1, 2]
    assert one.recv(0.05) is other.recv(0.05) is None


def received_by(port: BusPort | SocketCanPort) -> int:
    """The number in the next frame; a port may return early without one."""
    until_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < until_s:
        if (received := port.recv(PATIENCE_S)) is not None:
            return int.from_bytes(received.frame.data)
    raise AssertionError("a frame was lost")


@pytest.mark.parametrize("open_client", OF_PYTHON_CAN, indirect=True)
def test_a_client_receives_its_own_frames_when_it_asks_to(open_client: OpenClient) -> None:
    """No node wants them, so that the fast path does not offer them."""
    one, other = open_client(receive_own_messages=True), open_client()
    one.send(frame(1))
    other_saw, one_saw = receive(other), receive(one)
    assert one_saw.data == other_saw.data == frame(1).data


@pytest.mark.parametrize(
    "sent",
    [
        can.Message(arbitration_id=0, is_extended_id=False),
        can.Message(arbitration_id=0x7FF, is_extended_id=False, data=bytes(range(248, 256))),
        can.Message(arbitration_id=0, is_extended_id=True, data=b"\x00"),
        can.Message(arbitration_id=0x1FFFFFFF, is_extended_id=True, data=b"12345678"),
        can.Message(arbitration_id=0x123, is_extended_id=False, is_remote_frame=True),
        can.Message(arbitration_id=0x123, is_extended_id=False, is_fd=True, data=bytes(64)),
        can.Message(arbitration_id=5, is_extended_id=True, is_fd=True, data=bytes(12)),
        can.Message(
            arbitration_id=5, is_extended_id=False, is_fd=True, bitrate_switch=True, data=b"abc"
        ),
    ],
    ids=str,
)
def test_a_frame_arrives_as_it_was_sent(open_client: OpenClient, sent: can.Message) -> None:
    one, other = open_client(), open_client()
    one.send(sent)
    received = receive(other)
    assert received.equals(sent, None, check_channel=False, check_direction=False), received


def test_receiving_ends_without_a_frame_when_none_comes(open_client: OpenClient) -> None:
    bus = open_client()
    assert bus.recv(0) is None
    assert bus.recv(0.01) is None


def test_filters_let_through_what_they_name_until_they_are_changed(open_client: OpenClient) -> None:
    one, witness = open_client(), open_client()
    other = open_client(
        can_filters=[
            {"can_id": 0x100, "can_mask": 0x7F0, "extended": False},
            {"can_id": 0x123, "can_mask": 0x1FFFFFFF, "extended": True},
        ]
    )
    for number, can_id in enumerate([0x0FF, 0x100, 0x110, 0x10F, 0x123]):
        one.send(frame(number, can_id))
    one.send(can.Message(arbitration_id=0x123, is_extended_id=True, data=(9).to_bytes(4)))
    assert sorted(receive_numbers(other, 3)) == [1, 3, 9]

    # What is still on its way would pass the new filters.
    assert sorted(receive_numbers(witness, 6)) == [0, 1, 2, 3, 4, 9]
    assert other.recv(0.2) is None
    other.set_filters(None)
    one.send(frame(10, 0x7FF))
    assert receive_numbers(other, 1) == [10]


def test_who_joins_later_receives_what_comes_later(open_client: OpenClient) -> None:
    sender, early = open_client(), open_client()
    sender.send(frame(1))
    assert receive_numbers(early, 1) == [1]
    late = open_client()
    sender.send(frame(2))
    assert receive_numbers(late, 1) == [2]
    assert receive_numbers(early, 1) == [2]


def test_who_leaves_does_not_disturb_the_others(open_client: OpenClient) -> None:
    sender, leaver, stayer = [open_client() for _ in range(3)]
    sender.send(frame(1))
    leaver.shutdown()
    sender.send(frame(2))
    assert receive_numbers(stayer, 2) == [1, 2]


def test_what_was_sent_before_leaving_still_arrives(open_client: OpenClient) -> None:
    sender, receiver = open_client(), open_client()
    for number in range(50):
        sender.send(frame(number))
    sender.shutdown()
    assert receive_numbers(receiver, 50) == list(range(50))


def test_shutting_down_twice_is_allowed(open_client: OpenClient) -> None:
    bus = open_client()
    bus.shutdown()
    bus.shutdown()
