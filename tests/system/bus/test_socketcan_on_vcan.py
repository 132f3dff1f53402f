"""SocketCAN without python-can on real network interfaces, which come and go and fail.

A CAN controller with errors, error states and bus-off is the kernel's slcan with an emulated
adapter at the other end of its terminal. Needs the rights to make network interfaces.
"""

import errno
import fcntl
import os
import subprocess
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from steer_by_wire.dbc.messages import CAN_IDS, SteeringCommand, encode
from steer_by_wire.runtime.bus_model.socketcan_error_frames import error_causes
from steer_by_wire.runtime.exit_status import BusError, ExitStatus
from steer_by_wire.runtime.frame import ERROR, Frame
from steer_by_wire.runtime.port.interface_choice import socketcan_obstacle
from steer_by_wire.runtime.port.socketcan import SocketCanPort
from tests.support.frames.made_messages import error_of
from tests.support.programs.running_program import PATIENCE_S, RunningProgram, running
from tests.support.programs.slcan_adapter import AdapterBus

pytestmark = pytest.mark.vcan

CHANNEL = "vcan0"
_TIOCSETD, _N_SLCAN, _SIOCGIFNAME = 0x5423, 17, 0x8910
ADAPTER = 0
WARNING, PASSIVE, BUS_OFF, ACTIVE = b"sw110120", b"sp150140", b"sb256256", b"sa000000"
"""What an adapter reports of its error counters: state, received, transmitted."""
NO_ACKNOWLEDGE = b"e1a"


def ip(*arguments: str) -> None:
    """Change the network interfaces, or skip the test where that is not granted."""
    done = subprocess.run(["ip", *arguments], capture_output=True, text=True, check=False)
    if "not permitted" in done.stderr:
        pytest.skip(f"needs the right to change network interfaces: ip {' '.join(arguments)}")
    assert done.returncode == 0, f"ip {' '.join(arguments)}: {done.stderr}"


@pytest.fixture
def interface() -> Iterator[str]:
    """A virtual interface of this test's own, up."""
    name = "vcantest"
    make(name)
    yield name
    subprocess.run(["ip", "link", "del", name], capture_output=True, check=False)


def make(name: str) -> None:
    ip("link", "add", name, "type", "vcan")
    ip("link", "set", name, "up")


@pytest.fixture
def adapters(tmp_path: Path) -> Iterator[AdapterBus]:
    with AdapterBus([tmp_path / "tty"]) as bus:
        yield bus


@contextmanager
def attached(bus: AdapterBus) -> Iterator[str]:
    """Make the adapter a network interface, up, as ``slcand`` does; yields its name."""
    terminal = os.open(bus.adapters[ADAPTER].path, os.O_RDWR | os.O_NOCTTY)
    try:
        try:
            fcntl.ioctl(terminal, _TIOCSETD, _N_SLCAN.to_bytes(4, "little"))
        except OSError as error:
            if error.errno in (errno.EINVAL, errno.EPERM):
                pytest.skip(f"no slcan in this kernel, or no right to it ({error.strerror})")
            raise
        name = fcntl.ioctl(terminal, _SIOCGIFNAME, bytes(16)).rstrip(b"\0").decode()
        if not Path("/sys/class/net", name).exists():
            pytest.skip("slcan makes its interface in the host's network, not in this namespace")
        ip("link", "set", name, "type", "can", "bitrate", "500000")
        ip("link", "set", name, "up")
        yield name
    finally:
        os.close(terminal)


def receive(port: SocketCanPort) -> Frame:
    received = port.recv(PATIENCE_S)
    assert received is not None, "a frame was lost"
    return received.frame


def wait_for_frame(channel: str, can_id: int) -> None:
    """Wait until somebody sends a frame of this identifier."""
    port = SocketCanPort(channel, [{"can_id": can_id, "can_mask": 0x7FF, "extended": False}])
    frame = receive(port)
    while frame.flags & ERROR:  # these pass every filter, and may be on their way still
        frame = receive(port)
    assert frame.can_id == can_id
    port.shutdown()


# A virtual interface


def test_a_frame_comes_with_its_time_of_arrival() -> None:
    sender, receiver = SocketCanPort(CHANNEL), SocketCanPort(CHANNEL)
    arrivals_ns = []
    before_ns = time.monotonic_ns()
    for number in range(3):
        sender.send(Frame(0x5A0 + number, b""))
    after_ns = time.monotonic_ns()
    for number in range(3):
        received = receiver.recv(PATIENCE_S)
        assert received is not None
        assert received.frame == Frame(0x5A0 + number, b"")
        assert received.arrival_ns is not None
        arrivals_ns.append(received.arrival_ns)
    assert arrivals_ns == sorted(arrivals_ns)
    # Two clocks were read to compare them, which takes a stalled machine some time.
    slack_ns = 100_000_000
    assert before_ns - slack_ns <= arrivals_ns[0] <= arrivals_ns[-1] <= after_ns + slack_ns
    sender.shutdown()
    receiver.shutdown()


def test_can_fd_is_seen_only_by_who_asks_for_it() -> None:
    sender = SocketCanPort(CHANNEL, fd=True)
    classic, both = SocketCanPort(CHANNEL), SocketCanPort(CHANNEL, fd=True)
    fd_frame, last = Frame(0x5A0, bytes(64), 8), Frame(0x5A1, b"last")
    assert sender.send(fd_frame)
    assert sender.send(last)
    assert [receive(both), receive(both)] == [fd_frame, last]
    assert receive(classic) == last
    for port in (sender, classic, both):
        port.shutdown()


def test_frames_that_are_not_read_in_time_are_counted() -> None:
    sender, receiver = SocketCanPort(CHANNEL), SocketCanPort(CHANNEL)
    sent = received = 0
    for _ in range(2000):
        sent += sender.send(Frame(0x5A0, b"12345678"))
    while receiver.recv(0.0):
        received += 1
    assert receiver.dropped == 0  # it is reported with the next frame
    sent += sender.send(Frame(0x5A0, b"12345678"))
    receive(receiver)
    assert received + 1 < sent
    assert receiver.dropped == sent - received - 1
    sender.shutdown()
    receiver.shutdown()


def test_a_queue_that_is_full_refuses_frames_and_carries_on(interface: str) -> None:
    queue = ("root", "netem", "delay", "100s", "limit", "3")
    added = subprocess.run(
        ["tc", "qdisc", "add", "dev", interface, *queue],
        capture_output=True,
        text=True,
        check=False,
    )
    if added.returncode:
        pytest.skip(f"no queue with a limit here: {added.stderr.strip()}")
    port = SocketCanPort(interface)
    assert [port.send(Frame(0x5A0, b"12345678")) for _ in range(5)] == [True] * 3 + [False] * 2
    subprocess.run(["tc", "qdisc", "del", "dev", interface, "root"], check=True)
    assert port.send(Frame(0x5A0, b"12345678"))
    port.shutdown()


def test_an_interface_that_goes_down_or_away_is_reported(interface: str) -> None:
    port = SocketCanPort(interface)
    ip("link", "set", interface, "down")
    with pytest.raises(BusError, match=f"cannot receive: the network interface {interface} is do"):
        port.recv(PATIENCE_S)
    with pytest.raises(BusError, match=f"cannot send: the network interface {interface} is down"):
        port.send(Frame(1, b""))
    ip("link", "del", interface)
    with pytest.raises(BusError, match=f"cannot receive: the network interface {interface} has be"):
        port.recv(PATIENCE_S)
    with pytest.raises(BusError, match=f"cannot send: the network interface {interface} has been"):
        port.send(Frame(1, b""))
    port.shutdown()


@pytest.fixture
def report(tmp_path: Path) -> Path:
    return tmp_path / "report.json"


def start(stack: ExitStack, channel: str, report: Path, *more: str) -> RunningProgram:
    options = ["-i", "socketcan", "-c", channel, "--preset", "practical_pd", *more]
    return stack.enter_context(running("steer_by_wire.controller", options, report))


def test_foreign_traffic_wakes_no_program_and_a_forged_bus_off_stops_none(
    interface: str, report: Path
) -> None:
    with ExitStack() as stack:
        controller = start(stack, interface, report)
        sender = SocketCanPort(interface)
        for number in range(500):
            assert sender.send(Frame(0x5A0 + number % 2, b"foreign"))
        assert sender.send(Frame(0x40, bytes(8), ERROR))
        assert sender.send(encode(error_of(), 0))
        sender.shutdown()
        wait_for_frame(interface, CAN_IDS[SteeringCommand])  # the measurement, sent last, was read
        assert controller.interrupt() == ExitStatus.OK
        assert controller.report()["loop"]["frames_received"] == 1
        connection = controller.report()["connection"]
        assert connection["driver"] == "AF_CAN"
        assert connection["error_frames"] == {"forged_bus_off": 1}


# A CAN controller with errors


def test_error_frames_name_what_the_controller_saw(adapters: AdapterBus) -> None:
    with attached(adapters) as name:
        port = SocketCanPort(name, [{"can_id": 0x201, "can_mask": 0x7FF, "extended": False}])
        for said, causes in (
            (NO_ACKNOWLEDGE, {"bus_error", "no_acknowledge"}),
            (b"e1c", {"bus_error", "bit_error", "crc_error"}),
            (WARNING, {"error_warning"}),
            (PASSIVE, {"error_passive"}),
            (BUS_OFF, {"bus_off"}),
        ):
            assert not socketcan_obstacle(name)
            adapters.say(ADAPTER, said)
            frame = receive(port)
            assert frame.flags & ERROR
            # A driver may add that no acknowledge is a bit error too.
            assert causes <= set(error_causes(frame))
        assert "no carrier" in socketcan_obstacle(name)
        port.shutdown()


def test_bus_off_ends_the_run_with_one_line_its_causes_and_status_3(
    adapters: AdapterBus, report: Path
) -> None:
    with ExitStack() as stack:
        name = stack.enter_context(attached(adapters))
        controller = start(stack, name, report)
        for said in (NO_ACKNOWLEDGE, NO_ACKNOWLEDGE, WARNING, PASSIVE, BUS_OFF):
            adapters.say(ADAPTER, said)
        assert controller.end() == ExitStatus.BUS
        (error,) = [line for line in controller.printed if "error:" in line]
        assert "error: bus-off: " in error
        counts = controller.report()["connection"]["error_frames"]
        assert counts["no_acknowledge"] == 2
        assert counts["error_warning"] == counts["error_passive"] == counts["bus_off"] == 1
        assert any("error frames by cause: " in line for line in controller.printed)
