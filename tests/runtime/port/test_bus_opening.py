"""Bus that is opened, and the report of a failing one."""

import argparse
import itertools
import json
import random
import time
import uuid
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import can
import pytest
from can.interfaces.virtual import VirtualBus

from steer_by_wire.closed_loop.processes.process_group import launched_broker
from steer_by_wire.controller.command_line.program import main
from steer_by_wire.runtime.exit_status import BusError, ExitStatus
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.port import interface_choice, python_can
from steer_by_wire.runtime.port.interface_choice import add_bus_arguments, choose_bus
from steer_by_wire.runtime.port.python_can import BusPort, open_bus
from tests.support.programs.running_program import ORDINARY, PATIENCE_S


@pytest.fixture(autouse=True)
def no_configuration(
    monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """No configuration but a test's own, no network interfaces, no broker at the default address.

    Returns the directory that stands for that of the network interfaces.
    """
    for name in ("CAN_INTERFACE", "CAN_CHANNEL", "CAN_BITRATE", "CAN_CONFIG"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("can.util.CONFIG_FILES", [])
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path_factory.mktemp("run")))
    interfaces = tmp_path_factory.mktemp("net")
    monkeypatch.setattr(interface_choice, "_NETWORK_INTERFACES", interfaces)
    return interfaces


@pytest.fixture(scope="module")
def broker_address() -> Iterator[str]:
    with launched_broker(["--data-bitrate", "2000000"]) as address:
        yield address


def opened(*arguments: str) -> tuple[can.BusABC, str]:
    parser = argparse.ArgumentParser()
    add_bus_arguments(parser)
    options = parser.parse_args(arguments)
    bus, description = open_bus(options, choose_bus(options))
    bus.shutdown()
    return bus, description


def add_network_interface(directory: Path, name: str, kind: int, flags: int) -> None:
    (directory / name).mkdir()
    (directory / name / "type").write_text(f"{kind}\n")
    (directory / name / "flags").write_text(f"{flags:#x}\n")


def test_the_command_line_comes_first(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CAN_INTERFACE", "socketcan")
    bus, description = opened("-i", "virtual", "-c", "seven")
    assert isinstance(bus, VirtualBus)
    assert description == "Virtual bus channel seven (from the command line)"


def test_a_virtual_bus_is_said_to_end_at_the_process(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["-i", "virtual", "-c", uuid.uuid4().hex, "--duration", "0.05", *ORDINARY]
    assert main(["--preset", "practical_pd", *arguments]) == ExitStatus.OK
    assert (
        "python-can's virtual bus ends at this process: no other program is on it. "
        "Two programs meet on -i emulated\n"
    ) in capsys.readouterr().out


def test_the_environment_comes_before_the_configuration_file(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    configuration = tmp_path / "can.conf"
    configuration.write_text("[default]\ninterface = socketcan\nchannel = nine\n")
    monkeypatch.setattr("can.util.CONFIG_FILES", [str(configuration)])
    monkeypatch.setenv("CAN_INTERFACE", "virtual")
    assert opened()[1] == "Virtual bus channel nine (from the environment)"


def test_without_a_can_network_interface_the_emulated_bus_is_opened(
    monkeypatch: pytest.MonkeyPatch, broker_address: str
) -> None:
    monkeypatch.setenv("CAN_CONFIG", json.dumps({"address": broker_address}))
    assert opened("-c", "body")[1] == (
        "emulated bus, channel body, 500000 bit/s "
        "(no interface was given, and this machine has no network interface body)"
    )


def test_a_can_network_interface_that_is_up_is_preferred(
    no_configuration: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    add_network_interface(no_configuration, "vcan0", kind=280, flags=0xC1)
    monkeypatch.setitem(can.interfaces.BACKENDS, "socketcan", can.interfaces.BACKENDS["virtual"])
    assert opened()[1] == (
        "Virtual bus channel vcan0 (no interface was given, and this machine has it)"
    )


@pytest.mark.parametrize(
    ("kind", "flags", "reason"), [(280, 0xC0, "vcan0 is down"), (1, 0xC1, "vcan0 is not CAN")]
)
def test_a_network_interface_that_cannot_serve_is_passed_over_with_the_reason(
    no_configuration: Path,
    monkeypatch: pytest.MonkeyPatch,
    broker_address: str,
    kind: int,
    flags: int,
    reason: str,
) -> None:
    add_network_interface(no_configuration, "vcan0", kind, flags)
    monkeypatch.setenv("CAN_CONFIG", json.dumps({"address": broker_address}))
    _, description = opened()
    assert description.startswith("emulated bus, channel can0")
    assert reason in description


@pytest.mark.parametrize(
    ("arguments", "environment", "expected"),
    [
        (["-i", "socketcan", "-c", "vcan7"], {}, "no network interface vcan7"),
        (["-i", "socketcan"], {}, "no channel was given"),
        (["-i", "emulated"], {}, "start one with: steer-by-wire bus"),
        ([], {}, "no network interface vcan0.*start one with: steer-by-wire bus"),
        ([], {"CAN_INTERFACE": "nonesuch"}, "nonesuch"),
        ([], {"CAN_CONFIG": "{not json"}, "python-can's configuration, CAN_CONFIG, cannot be read"),
    ],
)
def test_a_bus_that_cannot_be_opened_is_reported_in_one_line(
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    environment: dict[str, str],
    expected: str,
) -> None:
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    with pytest.raises(BusError, match=expected) as caught:
        opened(*arguments)
    assert "\n" not in str(caught.value)


def test_a_port_reports_a_failed_bus_in_one_line() -> None:
    with launched_broker() as address:
        bus = can.Bus(interface="emulated", address=address)
    port = BusPort(bus)
    with pytest.raises(BusError, match=r"cannot receive: .*broker has ended"):
        port.recv(PATIENCE_S)
    with pytest.raises(BusError, match=r"cannot send: .*broker has ended"):
        port.send(Frame(1, b""))
    bus.shutdown()


class SilentBus(can.BusABC):
    """A bus on which no message comes; ``waits`` are the timeouts that it was given.

    ``share``  of a timeout that it waits; 0 as an interface that has lost its connection
    """

    def __init__(self, share: float) -> None:
        super().__init__(None)
        self._share = share
        self.waits: list[float] = []

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        raise AssertionError(msg, timeout)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        self.waits.append(timeout or 0.0)
        time.sleep(self._share * self.waits[-1])
        return None, False


@pytest.mark.parametrize("step_s", [-3600.0, 3600.0])
def test_a_wall_clock_that_is_set_changes_no_wait(
    step_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    wall_s = itertools.count(1.8e9, step_s)
    monkeypatch.setattr("can.bus.time", lambda: next(wall_s))
    monkeypatch.setattr("time.time", lambda: next(wall_s))
    bus = SilentBus(0.6)
    assert BusPort(bus).recv(0.002) is None
    assert max(bus.waits) == 0.002
    bus.shutdown()


def test_mistakes_in_pythons_can_configuration_are_one_line(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    rng = random.Random(58)
    parts = ["[default]\n", "[", "]", "interface", " = ", "virtual\n", "%off", "\ufeff", "\n", "a:"]
    values: list[object] = [None, 3, "virtual", ["fd"], {"a": 1}, True]
    file = tmp_path / "canrc"
    monkeypatch.setattr("can.util.CONFIG_FILES", [str(file)])
    namespace = argparse.Namespace()
    said: list[str] = []
    for _ in range(300):
        file.write_text("".join(rng.choices(parts, k=rng.randrange(8))))
        channel = {"interface": rng.choice(values), "channel": rng.choice(values)}
        monkeypatch.setenv("CAN_CONFIG", json.dumps(rng.choice([*values, channel, channel])))
        monkeypatch.setenv("CAN_INTERFACE", rng.choice(["", "virtual"]))
        try:
            choose_bus(namespace)
        except BusError as error:
            said.append(str(error))
    assert 50 < len(said) < 290
    assert not any("\n" in line for line in said)
    assert all(str(file) in line or "CAN_CONFIG" in line for line in said)


@pytest.mark.parametrize("wait_s", [PATIENCE_S, 0.001])
def test_an_interface_that_no_longer_waits_has_ended(wait_s: float) -> None:
    bus = SilentBus(0.0)  # socketcand returns at once, without a frame, after its daemon's end
    port = BusPort(bus)
    with pytest.raises(BusError, match="cannot receive: the interface's connection has ended"):
        assert all(port.recv(wait_s) is None for _ in range(20_000))
    bus.shutdown()


@pytest.mark.parametrize(("pause", "has_ended"), [(0.0, True), (0.7, True), (1.0, False)])
def test_it_is_found_on_a_busy_machine_too(
    pause: float, has_ended: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Which takes the processor away for a share of every 40th wait; a silent bus waits always."""
    turns, now_s = 0, 0.0

    def wait(_bus: object, timeout: float) -> tuple[None, bool]:
        nonlocal turns, now_s
        turns += 1
        now_s += timeout if not has_ended else 1e-5 + pause * timeout * (turns % 40 == 0)
        return None, False

    monkeypatch.setattr(python_can, "time", SimpleNamespace(monotonic=lambda: now_s))
    bus = SilentBus(0.0)
    monkeypatch.setattr(SilentBus, "_recv_internal", wait)
    port = BusPort(bus)
    try:
        assert all(port.recv(0.005) is None for _ in range(2_000))
        found = False
    except BusError:
        found = True
    bus.shutdown()
    assert found == has_ended


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["-i", "emulated", "--bus-kwargs", "addressx=x"], "no argument addressx .did you mean"),
        (["-i", "socketcand", "-c", "can0"], "give it --bus-kwargs host=... port=..."),
        (["-i", "kvaser", "-c", "0"], "its driver or library is not installed on this machine"),
    ],
)
def test_what_is_missing_to_open_an_interface_is_said(arguments: list[str], line: str) -> None:
    with pytest.raises(BusError, match=line):
        opened(*arguments)
