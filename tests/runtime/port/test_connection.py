"""A connection that counts error frames and reconnects to a lost bus, on fake ports."""

from collections import deque

import pytest

from steer_by_wire.runtime.bus_model.socketcan_error_frames import (
    BUS_OFF,
    FORGED_BUS_OFF,
    RESTARTED,
)
from steer_by_wire.runtime.exit_status import BusError
from steer_by_wire.runtime.frame import ERROR, Frame
from steer_by_wire.runtime.node import NS_PER_S
from steer_by_wire.runtime.node.real_time_loop import Received
from steer_by_wire.runtime.port import connection as connection_module
from steer_by_wire.runtime.port.connection import REPORTED_OUTAGES_MAX, SETTLED_S, Connection
from steer_by_wire.runtime.port.port import AF_CAN, PYTHON_CAN, OpenPort

PATIENCE_S = 10.0
DATA = Frame(0x201, b"data")
BUS_OFF_FRAME = Frame(0x40, bytes(8), ERROR)
RESTARTED_FRAME = Frame(0x100, bytes(8), ERROR)


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


class Machine:
    """A clock, and a bus that can be opened, or not."""

    def __init__(self, *, is_socketcan: bool = True) -> None:
        self.now_ns = 0
        self.is_there = True
        self.failed_attempts = 0
        self.is_socketcan = is_socketcan
        self.ports: list[FakePort] = []
        self.reported: list[str] = []

    def open(self) -> OpenPort:
        if not self.is_there:
            self.failed_attempts += 1
            raise BusError("cannot open: nothing is plugged in")
        self.ports.append(FakePort())
        driver = AF_CAN if self.is_socketcan else PYTHON_CAN
        return OpenPort(self.ports[-1], "a bus", "can7", driver, self.is_socketcan, self.open)

    def connect(self, patience_s: float = PATIENCE_S) -> Connection:
        return Connection(self.open(), patience_s, self.reported.append, lambda: self.now_ns)

    def wait_s(self, duration_s: float) -> None:
        self.now_ns += round(duration_s * NS_PER_S)


@pytest.fixture(autouse=True)
def carriers(monkeypatch: pytest.MonkeyPatch) -> dict[str, bool]:
    """No retry waits long, and network interfaces have the carriers that a test sets."""
    states: dict[str, bool] = {}
    monkeypatch.setattr(connection_module, "RETRY_S", 0.001)
    monkeypatch.setattr(connection_module, "has_carrier", states.get)
    return states


@pytest.fixture
def machine() -> Machine:
    return Machine()


def until_open(connection: Connection) -> None:
    """Wait until the thread has opened the bus again."""
    for _ in range(30_000):
        if connection.send(DATA):
            return
        connection.recv(0.01)
    raise AssertionError("the bus is not opened again")


# Error frames


def test_frames_pass_and_error_frames_are_counted_by_cause_and_pass_too(machine: Machine) -> None:
    connection = machine.connect(0.0)
    warning = Frame(0x204, b"\0\x08\0\0\0\0\x78\x6e", ERROR)
    machine.ports[0].waiting += [DATA, warning, warning, Frame(0xA8, b"\0\0\x19\0", ERROR)]
    received = [connection.recv(0.0) for _ in range(5)]
    assert [found and found.frame.flags for found in received] == [0, ERROR, ERROR, ERROR, None]
    assert connection.send(DATA)
    assert connection.figures.error_frames == {
        "bit_error": 1,
        "bus_error": 1,
        "error_warning": 2,
        "no_acknowledge": 1,
    }
    assert connection.figures.outages == 0


def test_error_frames_of_other_interfaces_name_no_cause() -> None:
    machine = Machine(is_socketcan=False)
    connection = machine.connect(0.0)
    machine.ports[0].waiting.append(BUS_OFF_FRAME)
    assert connection.recv(0.0) is not None
    assert connection.figures.error_frames == {"unspecified": 1}


# A connection that is not to be kept


def test_without_patience_a_bus_that_fails_ends_the_run(machine: Machine) -> None:
    connection = machine.connect(0.0)
    machine.ports[0].waiting.append(BusError("cannot receive: gone"))
    with pytest.raises(BusError, match="cannot receive: gone"):
        connection.recv(0.0)
    machine.ports[0].send_fails = True
    with pytest.raises(BusError, match="cannot send: gone"):
        connection.send(DATA)
    assert machine.reported == []
    connection.shutdown()
    assert machine.ports[0].is_shut_down


def test_without_patience_bus_off_ends_the_run_in_one_line(machine: Machine) -> None:
    connection = machine.connect(0.0)
    machine.ports[0].waiting.append(BUS_OFF_FRAME)
    with pytest.raises(BusError, match=r"^bus-off: [^\n]*$"):
        connection.recv(0.0)
    assert connection.figures.error_frames == {BUS_OFF: 1}


@pytest.mark.parametrize("patience_s", [0.0, PATIENCE_S])
def test_a_bus_off_of_an_interface_with_carrier_is_counted_as_forged_and_ends_nothing(
    machine: Machine, carriers: dict[str, bool], patience_s: float
) -> None:
    carriers["can7"] = True
    connection = machine.connect(patience_s)
    machine.ports[0].waiting.extend([BUS_OFF_FRAME, DATA])
    connection.recv(0.0)
    assert connection.recv(0.0) == Received(DATA, None)
    assert connection.send(DATA)
    assert connection.figures.error_frames == {FORGED_BUS_OFF: 1}
    assert connection.figures.outages == 0
    assert machine.reported == []


# A connection that is kept


def test_a_lost_bus_is_opened_again_and_reported(machine: Machine) -> None:
    connection = machine.connect()
    machine.ports[0].waiting.append(BusError("cannot receive: gone"))
    machine.ports[0].dropped = 3
    machine.is_there = False
    assert connection.recv(0.0) is None
    assert machine.reported == ["cannot receive: gone; waiting 10 s at most for the bus to return"]
    assert not connection.send(DATA)
    machine.wait_s(2.0)
    assert connection.recv(0.0) is None
    assert connection.figures.outage_ns == 2 * NS_PER_S
    machine.is_there = True
    until_open(connection)
    assert machine.ports[0].is_shut_down
    machine.ports[1].waiting.append(DATA)
    assert connection.recv(0.0) == Received(DATA, None)
    assert machine.reported[1:] == ["the bus is back after 2.00 s"]
    machine.wait_s(5.0)
    figures = connection.figures
    assert (figures.outages, figures.reconnections, figures.outage_ns) == (1, 1, 2 * NS_PER_S)
    assert figures.frames_dropped == 3
    connection.shutdown()
    assert machine.ports[1].is_shut_down


def test_a_bus_on_which_nobody_speaks_is_back_when_it_holds(machine: Machine) -> None:
    connection = machine.connect()
    machine.ports[0].send_fails = True
    assert not connection.send(DATA)
    until_open(connection)
    machine.wait_s(SETTLED_S)
    connection.recv(0.0)
    assert connection.figures.reconnections == 0
    machine.wait_s(0.01)
    connection.recv(0.0)
    assert connection.figures.reconnections == 1
    connection.shutdown()


def test_a_bus_that_fails_as_soon_as_it_is_open_has_not_come_back(machine: Machine) -> None:
    connection = machine.connect()
    machine.ports[0].send_fails = True
    assert not connection.send(DATA)
    for _ in range(3):
        until_open(connection)
        machine.wait_s(0.5 * SETTLED_S)
        machine.ports[-1].waiting.append(BusError("cannot receive: gone again"))
        assert connection.recv(0.0) is None
    assert connection.figures.outages == 1
    assert len(machine.reported) == 1
    machine.is_there = False
    machine.wait_s(PATIENCE_S)
    with pytest.raises(BusError, match="cannot receive: gone again; the bus has not returned for"):
        connection.recv(0.0)
    connection.shutdown()


def test_a_bus_that_stays_away_ends_the_run_and_says_what_the_last_attempt_met(
    machine: Machine,
) -> None:
    connection = machine.connect()
    machine.is_there = False
    machine.ports[0].waiting.append(BusError("cannot receive: gone"))
    assert connection.recv(0.0) is None
    while machine.failed_attempts < 2:
        assert connection.recv(0.01) is None
    machine.wait_s(PATIENCE_S + 0.1)
    with pytest.raises(BusError, match=r"has not returned for 10 s.*nothing is plugged in"):
        connection.recv(0.0)
    connection.shutdown()


def test_only_the_first_outages_are_reported(machine: Machine) -> None:
    connection = machine.connect()
    for _ in range(REPORTED_OUTAGES_MAX + 2):
        machine.ports[-1].waiting.append(BusError("cannot receive: gone"))
        assert connection.recv(0.0) is None
        until_open(connection)
        machine.ports[-1].waiting.append(DATA)
        assert connection.recv(0.0) is not None
    assert (
        connection.figures.outages == connection.figures.reconnections == REPORTED_OUTAGES_MAX + 2
    )
    assert len(machine.reported) == 2 * REPORTED_OUTAGES_MAX
    assert machine.reported[-2].endswith("more are only counted")
    connection.shutdown()


def test_a_connection_can_be_given_up_while_the_bus_is_away(machine: Machine) -> None:
    connection = machine.connect()
    machine.is_there = False
    machine.ports[0].waiting.append(BusError("cannot receive: gone"))
    assert connection.recv(0.0) is None
    connection.shutdown()
    assert machine.ports[0].is_shut_down


# Bus-off


def test_in_bus_off_nothing_is_sent_until_the_controller_has_restarted(machine: Machine) -> None:
    connection = machine.connect()
    port = machine.ports[0]
    port.waiting += [BUS_OFF_FRAME, DATA]
    assert connection.recv(0.0) is not None
    assert not connection.send(DATA)
    # What was received before it is no sign of life.
    assert connection.recv(0.0) == Received(DATA, None)
    assert not connection.send(DATA)
    assert (port.sent, port.is_shut_down) == ([], False)
    machine.wait_s(0.1)
    port.waiting.append(RESTARTED_FRAME)
    assert connection.recv(0.0) is not None
    assert connection.send(DATA)
    assert connection.figures.error_frames == {BUS_OFF: 1, RESTARTED: 1}
    assert machine.reported[0].startswith("bus-off: ")
    assert machine.reported[1] == "the bus is back after 0.10 s"


def test_bus_off_ends_with_the_carrier_too(machine: Machine, carriers: dict[str, bool]) -> None:
    connection = machine.connect()
    carriers["can7"] = False
    machine.ports[0].waiting.append(BUS_OFF_FRAME)
    assert connection.recv(0.0) is not None
    machine.wait_s(1.0)
    assert connection.recv(0.0) is None
    assert not connection.send(DATA)
    carriers["can7"] = True
    machine.wait_s(1.0)
    assert connection.recv(0.0) is None
    assert connection.send(DATA)
    assert connection.figures.outage_ns == 2 * NS_PER_S


def test_an_interface_that_is_taken_down_in_bus_off_is_opened_again(machine: Machine) -> None:
    connection = machine.connect()
    machine.ports[0].waiting += [BUS_OFF_FRAME, BusError("cannot receive: it is down")]
    assert connection.recv(0.0) is not None
    assert connection.recv(0.0) is None
    until_open(connection)
    machine.ports[1].waiting.append(DATA)
    assert connection.recv(0.0) is not None
    assert (connection.figures.outages, connection.figures.reconnections) == (1, 1)
    connection.shutdown()
