"""Addresses of the emulated bus, and whom the rights of the file system let in."""

import stat
from contextlib import ExitStack
from pathlib import Path

import can
import pytest

from steer_by_wire.runtime.emulated_bus.address import (
    AddressError,
    TcpAddress,
    listening,
    parse_address,
)
from tests.support.programs.broker_program import client, message, receive, start_broker
from tests.support.programs.broker_program import directory as directory
from tests.support.programs.broker_program import stack as stack
from tests.support.programs.running_program import PATIENCE_S


def test_only_its_user_can_open_the_socket(
    stack: ExitStack, directory: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(directory))
    start_broker(stack)
    home = directory / "emulated-can-bus"
    assert stat.S_IMODE(home.stat().st_mode) == 0o700
    assert stat.S_IMODE((home / "socket").stat().st_mode) == 0o600
    configurations = can.detect_available_configs("emulated")
    assert configurations == [{"interface": "emulated", "channel": "can0"}]


def test_a_directory_that_others_can_enter_is_not_used(
    stack: ExitStack, directory: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(directory))
    (directory / "emulated-can-bus").mkdir()
    (directory / "emulated-can-bus").chmod(0o755)
    assert start_broker(stack).wait(PATIENCE_S) == 3
    with pytest.raises(can.CanInitializationError, match="mode 0700"):
        can.Bus(interface="emulated", ignore_config=True)


def test_a_socket_at_a_path_of_one_s_own_is_its_user_s_alone(
    stack: ExitStack, directory: Path
) -> None:
    address = directory / "socket"
    directory.chmod(0o755)
    start_broker(stack, "--address", str(address))
    assert stat.S_IMODE(address.stat().st_mode) == 0o600
    assert stat.S_IMODE(Path(f"{address}.lock").stat().st_mode) == 0o600


def test_a_directory_that_all_may_write_to_is_refused(directory: Path) -> None:
    directory.chmod(0o777)
    with pytest.raises(AddressError, match="every user may write"), listening(directory / "socket"):
        pass
    directory.chmod(0o1777)  # as /tmp: only the owner of a file removes it
    with listening(directory / "socket"):
        pass


def test_tcp_works_on_the_loopback(stack: ExitStack) -> None:
    broker = start_broker(stack, "--address", "localhost:0")
    assert broker.stdout is not None
    address = broker.stdout.readline().partition(" at ")[2].partition(",")[0]
    one, other = client(stack, address), client(stack, address)
    for number in range(100):
        one.send(message(1, bytes([number])))
    one.shutdown()
    assert [receive(other).data[0] for _ in range(100)] == list(range(100))


@pytest.mark.parametrize("text", ["0.0.0.0:1", "192.168.1.1:29580", "", "127.0.0.1:x", "127.1:1"])
def test_no_address_but_the_loopback_is_listened_at(text: str) -> None:
    with pytest.raises(AddressError, match=r"127\.0\.0\.1"):
        parse_address(text)


def test_a_port_in_use_is_reported(stack: ExitStack) -> None:
    taken = stack.enter_context(listening(TcpAddress("127.0.0.1", 0)))
    with (
        pytest.raises(AddressError, match="cannot listen"),
        listening(TcpAddress("127.0.0.1", taken.getsockname()[1])),
    ):
        pass
