"""A connection that counts error frames and ends with its bus, on a fake port."""

from collections import deque

import pytest

from steer_by_wire.runtime.bus_model.socketcan_error_frames import BUS_OFF, FORGED_BUS_OFF
from steer_by_wire.runtime.exit_status import BusError
from steer_by_wire.runtime.frame import ERROR, Frame
from steer_by_wire.runtime.node.real_time_loop import Received
from steer_by_wire.runtime.port import port as port_module
from steer_by_wire.runtime.port.port import AF_CAN, PYTHON_CAN, Connection

DATA = Frame(0x201, b"data")
BUS_OFF_FRAME = Frame(0x40, bytes(8), ERROR)


class FakePort:
    """Receives what ``waiting`` holds; an exception there is raised."""

    def __init__(self) -> None:
        self.waiting: deque[Frame | BusError] = deque()
        self.sent: list[Frame] = []
        self.send_fails = False
        self.is_shut_down = False
        self.dropped = 0

    def recv(self, _timeout_s: float) -> Received | None:
        if not self.waiting:
            return None
        found = self.waiting.popleft()
        if isinstance(found, BusError):
            raise found
        return Received(found, None)

    def send(self, frame: Frame) -> bool:
        if self.send_fails:
            raise BusError("cannot send: gone")
        self.sent.append(frame)
        return True

    def shutdown(self) -> None:
        self.is_shut_down = True


def connected(port: FakePort, *, is_socketcan: bool = True) -> Connection:
    driver = AF_CAN if is_socketcan else PYTHON_CAN
    return Connection(port, "a bus", "can7", driver, is_socketcan=is_socketcan)


@pytest.fixture(autouse=True)
def carriers(monkeypatch: pytest.MonkeyPatch) -> dict[str, bool]:
    """Network interfaces have the carriers that a test sets."""
    states: dict[str, bool] = {}
    monkeypatch.setattr(port_module, "has_carrier", states.get)
    return states


@pytest.fixture
def port() -> FakePort:
    return FakePort()


def test_frames_pass_and_error_frames_are_counted_by_cause_and_pass_too(port: FakePort) -> None:
    connection = connected(port)
    warning = Frame(0x204, b"\0\x08\0\0\0\0\x78\x6e", ERROR)
    port.waiting += [DATA, warning, warning, Frame(0xA8, b"\0\0\x19\0", ERROR)]
    port.dropped = 3
    received = [connection.recv(0.0) for _ in range(5)]
    assert [found and found.frame.flags for found in received] == [0, ERROR, ERROR, ERROR, None]
    assert connection.send(DATA)
    assert connection.report()["error_frames"] == {
        "bit_error": 1,
        "bus_error": 1,
        "error_warning": 2,
        "no_acknowledge": 1,
    }
    assert connection.report()["frames_dropped"] == 3


def test_error_frames_of_other_interfaces_name_no_cause(port: FakePort) -> None:
    connection = connected(port, is_socketcan=False)
    port.waiting.append(BUS_OFF_FRAME)
    assert connection.recv(0.0) is not None
    assert connection.report()["error_frames"] == {"unspecified": 1}


def test_a_bus_that_fails_ends_the_run(port: FakePort) -> None:
    connection = connected(port)
    port.waiting.append(BusError("cannot receive: gone"))
    with pytest.raises(BusError, match="cannot receive: gone"):
        connection.recv(0.0)
    port.send_fails = True
    with pytest.raises(BusError, match="cannot send: gone"):
        connection.send(DATA)
    connection.shutdown()
    assert port.is_shut_down


def test_bus_off_ends_the_run_in_one_line(port: FakePort) -> None:
    connection = connected(port)
    port.waiting.append(BUS_OFF_FRAME)
    with pytest.raises(BusError, match=r"^bus-off: [^\n]*$"):
        connection.recv(0.0)
    assert connection.report()["error_frames"] == {BUS_OFF: 1}


def test_a_bus_off_of_an_interface_with_carrier_is_counted_as_forged_and_ends_nothing(
    port: FakePort, carriers: dict[str, bool]
) -> None:
    carriers["can7"] = True
    connection = connected(port)
    port.waiting.extend([BUS_OFF_FRAME, DATA])
    connection.recv(0.0)
    assert connection.recv(0.0) == Received(DATA, None)
    assert connection.send(DATA)
    assert connection.report()["error_frames"] == {FORGED_BUS_OFF: 1}
