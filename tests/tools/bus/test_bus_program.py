"""The program of the emulated bus as its users meet it: start, end, overload, other programs."""

import errno
import re
import select
import signal
import socket
import subprocess
import sys
import threading
from contextlib import ExitStack
from pathlib import Path

import can
import pytest

from steer_by_wire.closed_loop.processes.process_group import launched_broker
from steer_by_wire.runtime.emulated_bus.broker import CHANNELS_MAX, CLIENTS_MAX, Broker
from steer_by_wire.runtime.emulated_bus.protocol import HELLO
from steer_by_wire.tools.bus.program import _first_signal, main
from tests.support.programs.broker_program import client, message, receive, start_broker
from tests.support.programs.broker_program import directory as directory
from tests.support.programs.broker_program import stack as stack
from tests.support.programs.running_program import PATIENCE_S

# Life and death of a broker


def test_a_broker_that_dies_gives_its_clients_a_clear_error(
    stack: ExitStack, directory: Path
) -> None:
    address = str(directory / "socket")
    broker = start_broker(stack, "--address", address)
    one, other = client(stack, address), client(stack, address)
    one.send(message(1))
    assert receive(other).arbitration_id == 1
    broker.kill()
    broker.wait()
    for _ in range(2):
        with pytest.raises(can.CanOperationError, match="its broker has ended"):
            other.recv(PATIENCE_S)
        with pytest.raises(can.CanOperationError, match="its broker has ended"):
            other.send(message(1))


def test_without_a_broker_the_error_names_the_command_that_starts_one(directory: Path) -> None:
    address = str(directory / "socket")
    with pytest.raises(can.CanInitializationError) as caught:
        can.Bus(interface="emulated", address=address)
    assert str(caught.value).endswith(f"start one with: steer-by-wire bus --address {address}")


def test_the_socket_of_a_killed_broker_is_taken_over(stack: ExitStack, directory: Path) -> None:
    address = str(directory / "socket")
    killed = start_broker(stack, "--address", address)
    killed.kill()
    killed.wait()
    assert Path(address).is_socket()
    start_broker(stack, "--address", address)
    one, other = client(stack, address), client(stack, address)
    one.send(message(1))
    assert receive(other).arbitration_id == 1


def test_a_second_broker_leaves_the_first_alone(stack: ExitStack, directory: Path) -> None:
    address = str(directory / "socket")
    start_broker(stack, "--address", address)
    second = start_broker(stack, "--address", address)
    _, errors = second.communicate(timeout=PATIENCE_S)
    assert second.returncode == 3
    assert (
        errors == f"steer-by-wire bus: error: an emulated bus is already listening at {address}\n"
    )
    client(stack, address).send(message(1))


def test_a_file_that_is_no_socket_is_left_alone(stack: ExitStack, directory: Path) -> None:
    precious = directory / "precious"
    precious.write_text("data")
    broker = start_broker(stack, "--address", str(precious))
    assert broker.wait(PATIENCE_S) == 3
    assert precious.read_text() == "data"


def test_clients_meet_the_traffic_that_was_asked_for(stack: ExitStack, directory: Path) -> None:
    address = str(directory / "socket")
    broker = start_broker(stack, "--address", address, "--load", "0.5")
    listening = client(stack, address)
    assert len({receive(listening).arbitration_id for _ in range(100)}) >= 5
    broker.send_signal(signal.SIGINT)
    _, errors = broker.communicate(timeout=PATIENCE_S)
    assert int(re.findall(r"can0 (\d+) frames", errors)[0]) >= 100


@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_the_broker_in_order(
    stack: ExitStack, directory: Path, ending: signal.Signals
) -> None:
    address = str(directory / "socket")
    broker = start_broker(stack, "--address", address)
    one, other = (client(stack, address, channel="body") for _ in range(2))
    one.send(message(1))
    receive(other)
    broker.send_signal(ending)
    _, errors = broker.communicate(timeout=PATIENCE_S)
    assert broker.returncode == 0
    assert "; body 1 frames, load " in errors
    assert errors.count("\n") == 1
    assert not Path(address).exists()


def test_a_bus_that_fails_says_where_and_why(
    directory: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(*_arguments: object) -> None:
        raise OSError(errno.EBADF, "Bad file descriptor")

    monkeypatch.setattr(Broker, "run", fail)
    address = directory / "socket"
    assert main(["--address", str(address)]) == 3
    said = capsys.readouterr().err.splitlines()[-1]
    assert said == (
        f"steer-by-wire bus: error: the bus at {address} has failed: Bad file descriptor"
    )


def test_a_launched_broker_ends_with_its_launcher(stack: ExitStack) -> None:
    code = (
        "from steer_by_wire.closed_loop.processes.process_group import launched_broker\n"
        "with launched_broker() as address:\n"
        "    print(address, flush=True)\n"
        "    input()\n"
    )
    launcher = stack.enter_context(
        subprocess.Popen(
            [sys.executable, "-c", code],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
    )
    assert launcher.stdout is not None
    bus = client(stack, launcher.stdout.readline().strip())
    launcher.kill()
    with pytest.raises(can.CanOperationError, match="its broker has ended"):
        bus.recv(PATIENCE_S)


def test_a_launched_broker_that_does_not_start_is_reported() -> None:
    with pytest.raises(RuntimeError, match="has not started"), launched_broker(["--bitrate", "1"]):
        pass


# Overload


@pytest.mark.parametrize(
    ("most", "channels", "reason"),
    [(CLIENTS_MAX, 1, "200 clients already"), (CHANNELS_MAX, CHANNELS_MAX + 1, "64 channels")],
)
def test_there_is_a_limit_to_clients_and_to_channels(
    stack: ExitStack, directory: Path, most: int, channels: int, reason: str
) -> None:
    address = str(directory / "socket")
    start_broker(stack, "--address", address)
    for number in range(most):
        client(stack, address, channel=str(number % channels))
    with pytest.raises(can.CanInitializationError, match=reason):
        client(stack, address, channel=str(most % channels))


def test_the_end_says_what_was_carried_and_who_was_thrown_out(
    stack: ExitStack, directory: Path
) -> None:
    address = str(directory / "socket")
    broker = start_broker(stack, "--address", address)
    one, other = client(stack, address), client(stack, address)
    vandal = stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
    vandal.settimeout(PATIENCE_S)
    vandal.connect(address)
    vandal.sendall(bytes(HELLO.size))
    assert vandal.recv(1) == b""
    one.send(message(1))
    receive(other)
    broker.send_signal(signal.SIGTERM)
    _, errors = broker.communicate(timeout=PATIENCE_S)
    assert broker.returncode == 0
    said, last = errors.splitlines()
    assert re.search(r"client 3 \(process \d+\) leaves: it does not speak this version", said)
    assert "; can0 1 frames, " in last
    assert "disconnected: 1 garbage" in last


def test_ctrl_c_before_it_listens_is_no_orderly_end(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*_arguments: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("steer_by_wire.tools.bus.program.listening", interrupt)
    assert main(["--address", "127.0.0.1:0"]) == 130


# python-can's own programs


def test_a_signal_that_another_thread_takes_ends_a_broker_that_waits() -> None:
    def take() -> None:
        signal.pthread_kill(threading.get_ident(), signal.SIGTERM)

    with _first_signal() as signalled:
        timer = threading.Timer(0.2, take)
        timer.start()
        readable, _, _ = select.select([signalled], [], [], PATIENCE_S)
        timer.join()
    assert readable == [signalled]
