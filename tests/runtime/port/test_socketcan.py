"""SocketCAN without python-can: layouts, filters, time stamps and failures, without CAN."""

import errno
import socket
import struct
import sys
from collections import deque
from typing import Any

import can
import pytest

from steer_by_wire.runtime.exit_status import BusError
from steer_by_wire.runtime.frame import BITRATE_SWITCH, ERROR, EXTENDED, FD, REMOTE, Frame
from steer_by_wire.runtime.frame.message import frame_of
from steer_by_wire.runtime.frame.socketcan_layout import packed, unpacked
from steer_by_wire.runtime.node.real_time_loop import Received
from steer_by_wire.runtime.port import socketcan
from steer_by_wire.runtime.port.socketcan import ArrivalClock, SocketCanPort, checked_filters

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="only Linux has SocketCAN")

S = 1_000_000_000
SOL_CAN_RAW, FILTER, ERR_FILTER, FD_FRAMES = 101, 1, 2, 5
SO_TIMESTAMPNS, SO_RXQ_OVFL = 35, 40
FRAMES = [
    Frame(0, b""),
    Frame(0x7FF, b"12345678"),
    Frame(0x201, b"abc"),
    Frame(0, b"x", EXTENDED),
    Frame(0x1FFFFFFF, b"12345678", EXTENDED),
    Frame(0x123, b"", REMOTE),
    Frame(0x12345, b"", REMOTE | EXTENDED),
    Frame(0x7FF, bytes(range(64)), FD),
    Frame(0x1, b"abcdefghijkl", FD | BITRATE_SWITCH | EXTENDED),
]


class FakeSocket:
    """The socket of a port: what is set is kept, what is received or raised is in ``waiting``."""

    def __init__(self, *_arguments: object) -> None:
        self.options: dict[tuple[int, int], int | bytes] = {}
        self.bound: tuple[str, ...] = ()
        self.waiting: deque[OSError | tuple[bytes, list[tuple[int, int, bytes]]]] = deque()
        self.sent: list[bytes] = []
        self.fails: OSError | None = None
        self.is_closed = False

    def setsockopt(self, level: int, name: int, value: int | bytes) -> None:
        self.options[level, name] = value

    def bind(self, address: tuple[str, ...]) -> None:
        if self.fails:
            raise self.fails
        self.bound = address

    def recvmsg(self, _size: int, _ancillary: int) -> tuple[bytes, list[Any], int, tuple[str]]:
        if not self.waiting:
            raise BlockingIOError
        found = self.waiting.popleft()
        if isinstance(found, OSError):
            raise found
        return (*found, 0, ("can0",))

    def send(self, raw: bytes) -> int:
        if self.fails:
            raise self.fails
        self.sent.append(raw)
        return len(raw)

    def close(self) -> None:
        self.is_closed = True


@pytest.fixture
def sockets(monkeypatch: pytest.MonkeyPatch) -> list[FakeSocket]:
    """Every socket that is made."""
    made: list[FakeSocket] = []

    def make(*arguments: object) -> FakeSocket:
        made.append(FakeSocket(*arguments))
        return made[-1]

    monkeypatch.setattr("steer_by_wire.runtime.port.socketcan.socket.socket", make)
    return made


# Layouts


@pytest.mark.parametrize("frame", FRAMES, ids=str)
def test_a_frame_survives_the_kernel_s_layout(frame: Frame) -> None:
    raw = packed(frame)
    assert len(raw) == (72 if frame.flags & FD else 16)
    assert unpacked(raw) == frame


@pytest.mark.parametrize("can_id", [0x40, 0x204, 0x1FFFFFFF])
def test_an_error_frame_is_what_python_can_makes_of_it(can_id: int) -> None:
    raw = struct.pack("=IB3x8s", 0x20000000 | can_id, 8, b"\0\x10\0\0\0\0\x8c\x96")
    frame = unpacked(raw)
    assert frame == Frame(can_id, b"\0\x10\0\0\0\0\x8c\x96", ERROR)
    if can_id <= 0x7FF:
        message = can.Message(
            arbitration_id=can_id, is_extended_id=False, is_error_frame=True, data=frame.data
        )
        assert frame_of(message) == frame


@pytest.mark.parametrize("frame", [Frame(1, bytes(9)), Frame(1, bytes(65), FD)])
def test_a_payload_that_is_too_long_is_no_frame(frame: Frame) -> None:
    with pytest.raises(ValueError, match="too many"):
        packed(frame)


# Opening


@pytest.mark.parametrize("wrong", ["abc", [{"id": 1}], [{"can_id": "1", "can_mask": 1}], [1]])
def test_what_are_no_filters_is_reported(wrong: Any) -> None:
    with pytest.raises(ValueError, match="is no list of"):
        checked_filters(wrong)


def test_a_port_asks_for_error_frames_time_stamps_and_what_is_to_be_received(
    sockets: list[FakeSocket],
) -> None:
    filters: list[Any] = [{"can_id": 0x201, "can_mask": 0x7FF, "extended": False}]
    SocketCanPort("can7", filters)
    (made,) = sockets
    assert made.bound == ("can7",)
    assert made.options == {
        (SOL_CAN_RAW, ERR_FILTER): 0x1FFFFFFF,
        (SOL_CAN_RAW, FD_FRAMES): 0,
        (SOL_CAN_RAW, FILTER): struct.pack("=II", 0x201, 0x800007FF),
        (socket.SOL_SOCKET, SO_TIMESTAMPNS): 1,
        (socket.SOL_SOCKET, SO_RXQ_OVFL): 1,
    }


def test_a_port_that_cannot_be_opened_leaves_no_socket(monkeypatch: pytest.MonkeyPatch) -> None:
    made = FakeSocket()
    made.fails = OSError(errno.ENODEV, "No such device")
    monkeypatch.setattr("steer_by_wire.runtime.port.socketcan.socket.socket", lambda *_: made)
    with pytest.raises(OSError, match="No such device"):
        SocketCanPort("can7", fd=True)
    assert made.is_closed


# Receiving


def test_a_frame_comes_with_the_kernel_s_time_on_the_monotonic_clock(
    sockets: list[FakeSocket], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(socketcan, "wall_minus_monotonic_ns", lambda: 1000 * S)
    port = SocketCanPort("can7")
    stamp = socket.SOL_SOCKET, SO_TIMESTAMPNS, struct.pack("@ll", 1007, 25)
    sockets[0].waiting += [(packed(FRAMES[1]), [stamp]), (packed(FRAMES[2]), [])]
    assert port.recv(0.0) == Received(FRAMES[1], 7 * S + 25)
    assert port.recv(-1.0) == Received(FRAMES[2], None)
    assert port.recv(0.0) is None


@pytest.mark.parametrize(
    ("code", "words"),
    [
        (errno.ENETDOWN, "the network interface can7 is down"),
        (errno.ENODEV, "the network interface can7 has been removed"),
        (errno.EIO, "Input/output error"),
    ],
)
def test_an_interface_that_goes_away_is_reported_in_one_line(
    sockets: list[FakeSocket], code: int, words: str
) -> None:
    port = SocketCanPort("can7")
    sockets[0].waiting.append(OSError(code, "Input/output error"))
    with pytest.raises(BusError, match=f"^cannot receive: {words}$"):
        port.recv(0.0)
    sockets[0].fails = OSError(code, "Input/output error")
    with pytest.raises(BusError, match=f"^cannot send: {words}$"):
        port.send(FRAMES[1])


# Sending


def test_an_interface_without_can_fd_is_reported_in_one_line(sockets: list[FakeSocket]) -> None:
    port = SocketCanPort("can0", fd=True)
    sockets[0].fails = OSError(errno.EINVAL, "Invalid argument")
    with pytest.raises(BusError) as caught:
        port.send(Frame(0x123, bytes(20), FD))
    line = "cannot send: the network interface can0 carries classic frames only, not CAN FD"
    assert str(caught.value) == line
    with pytest.raises(BusError, match="Invalid argument"):
        port.send(Frame(0x123, bytes(8)))


@pytest.mark.parametrize("code", [errno.ENOBUFS, errno.EAGAIN])
def test_a_full_queue_refuses_a_frame_and_does_not_fail(
    sockets: list[FakeSocket], code: int
) -> None:
    port = SocketCanPort("can7")
    sockets[0].fails = OSError(code, "full")
    assert not port.send(FRAMES[1])
    sockets[0].fails = None
    assert port.send(FRAMES[1])


# Time stamps


class Offset:
    """The distance of two clocks, and how often it was read."""

    def __init__(self, distance_ns: int) -> None:
        self.distance_ns = distance_ns
        self.readings = 0

    def __call__(self) -> int:
        self.readings += 1
        return self.distance_ns


@pytest.fixture
def offset(monkeypatch: pytest.MonkeyPatch) -> Offset:
    offset = Offset(1000 * S)
    monkeypatch.setattr(socketcan, "wall_minus_monotonic_ns", offset)
    return offset


@pytest.mark.parametrize("step_s", [3600, -3600, 2, -2])
def test_a_wall_clock_that_is_set_is_followed(offset: Offset, step_s: int) -> None:
    clock = ArrivalClock()
    assert clock.monotonic_ns(1005 * S) == 5 * S
    offset.distance_ns += step_s * S
    assert clock.monotonic_ns(1006 * S + step_s * S) == 6 * S


def test_the_distance_of_the_clocks_is_that_of_the_quickest_of_three_readings(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Time:
        """Stands for the module: the first and the last reading are interrupted."""

        monotonic = iter([100, 900, 1000, 1010, 2000, 2500])
        wall = iter([5150, 6005, 7100])

        def monotonic_ns(self) -> int:
            return next(self.monotonic)

        def time_ns(self) -> int:
            return next(self.wall)

    monkeypatch.setattr(socketcan, "time", Time())
    assert socketcan.wall_minus_monotonic_ns() == 5000
