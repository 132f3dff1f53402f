"""Port that a node gets: AF_CAN or python-can, with what filters, with which options."""

import argparse
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import can
import pytest

from steer_by_wire.runtime.exit_status import BusError
from steer_by_wire.runtime.frame import ERROR, Frame
from steer_by_wire.runtime.frame.message import message_of
from steer_by_wire.runtime.port import interface_choice
from steer_by_wire.runtime.port import port as port_module
from steer_by_wire.runtime.port.interface_choice import add_bus_arguments
from steer_by_wire.runtime.port.port import AF_CAN, PYTHON_CAN, Connection, open_port

IDS = [0x210, 0x201]
FILTERS = [{"can_id": can_id, "can_mask": 0x7FF, "extended": False} for can_id in sorted(IDS)]


class Adapter(can.BusABC):
    """An interface plugin that notes what it is opened with."""

    opened_with: list[dict[str, Any]] = []  # noqa: RUF012 of all of them

    def __init__(self, channel: str, can_filters: Any = None, **options: Any) -> None:
        self.opened_with.append({"channel": channel, **options})
        self.channel_info = f"adapter {channel}"
        self.waiting: list[can.Message] = []
        super().__init__(channel, can_filters=can_filters)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send nothing."""

    def _recv_internal(
        self,
        timeout: float | None,  # noqa: ARG002 as in the base class
    ) -> tuple[can.Message | None, bool]:
        return (self.waiting.pop(0), False) if self.waiting else (None, False)


class FilteringAdapter(Adapter):
    """One whose hardware filters."""

    def _apply_filters(self, filters: Any) -> None:
        self.hardware_filters = filters


class FastPort:
    """Stands for SocketCanPort."""

    def __init__(self, channel: str, filters: Any = None, *, fd: bool = False) -> None:
        self.given = (channel, filters, fd)
        if channel == "can9":
            raise OSError(1, "Operation not permitted")

    def shutdown(self) -> None:
        """Nothing."""


@pytest.fixture(autouse=True)
def machine(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A machine with the network interfaces can0 and can9, the two plugins, and no configuration.

    Returns the directory that stands for that of the network interfaces.
    """
    for name in ("CAN_INTERFACE", "CAN_CHANNEL", "CAN_BITRATE", "CAN_CONFIG"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr("can.util.CONFIG_FILES", [])
    plugins = {"adapter": "Adapter", "filtering": "FilteringAdapter"}
    for name, plugin in plugins.items():
        monkeypatch.setitem(can.interfaces.BACKENDS, name, (__name__, plugin))
    monkeypatch.setattr("can.util.VALID_INTERFACES", [*can.VALID_INTERFACES, *plugins])
    monkeypatch.setattr("can.VALID_INTERFACES", [*can.VALID_INTERFACES, *plugins])
    monkeypatch.setattr(Adapter, "opened_with", [])
    monkeypatch.setattr(port_module, "SocketCanPort", FastPort)
    interfaces = tmp_path_factory.mktemp("net")
    monkeypatch.setattr(interface_choice, "_NETWORK_INTERFACES", interfaces)
    for name in ("can0", "can9"):
        (interfaces / name).mkdir()
        (interfaces / name / "type").write_text("280\n")
        (interfaces / name / "flags").write_text("0xc1\n")
    return interfaces


@pytest.fixture
def python_can(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let python-can's socketcan be the plugin that filters."""
    monkeypatch.setitem(can.interfaces.BACKENDS, "socketcan", (__name__, "FilteringAdapter"))


def opened(*arguments: str, ids: Sequence[int] | None = IDS) -> Connection:
    parser = argparse.ArgumentParser()
    add_bus_arguments(parser)
    found = open_port(parser.parse_args(arguments), ids)
    found.port.shutdown()
    return found


def bus_of(found: Connection) -> Any:
    return found.port.bus


def given(found: Connection) -> Any:
    return found.port.given


# The fast path


def test_socketcan_is_opened_without_python_can_and_says_so() -> None:
    found = opened("-i", "socketcan", "-c", "can0")
    assert given(found) == ("can0", FILTERS, False)
    assert found.description == "SocketCAN can0 by AF_CAN (from the command line)"
    assert (found.channel, found.driver, found.is_socketcan) == ("can0", AF_CAN, True)


def test_fd_reaches_the_fast_path(monkeypatch: pytest.MonkeyPatch) -> None:
    assert given(opened("-i", "socketcan", "-c", "can0", "--fd"))[2]
    monkeypatch.setenv("CAN_CONFIG", json.dumps({"fd": True}))
    assert given(opened("-i", "socketcan", "-c", "can0"))[2]


def test_filters_of_the_configuration_come_before_those_of_the_node(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    wanted = [{"can_id": 1, "can_mask": 3}]
    monkeypatch.setenv("CAN_CONFIG", json.dumps({"can_filters": wanted}))
    assert given(opened("-i", "socketcan", "-c", "can0"))[1] == wanted
    assert bus_of(opened("-i", "filtering", "-c", "x")).hardware_filters == wanted


@pytest.mark.usefixtures("python_can")
@pytest.mark.parametrize("option", ["receive_own_messages=True", "local_loopback=False"])
def test_what_only_python_can_has_is_opened_by_python_can(option: str) -> None:
    found = opened("-i", "socketcan", "-c", "can0", "--bus-kwargs", option)
    assert (found.driver, found.is_socketcan) == (PYTHON_CAN, True)
    assert bus_of(found).hardware_filters == FILTERS
    assert option.split("=")[0] in Adapter.opened_with[-1]


def test_an_interface_that_cannot_be_opened_is_reported_in_one_line(machine: Path) -> None:
    with pytest.raises(BusError, match=r"^cannot open socketcan can9 \(.*\): Operation not perm"):
        opened("-i", "socketcan", "-c", "can9")
    with pytest.raises(BusError, match="no network interface can1"):
        opened("-i", "socketcan", "-c", "can1")
    (machine / "can0" / "carrier").write_text("0\n")
    with pytest.raises(BusError, match="can0 has no carrier: it is in bus-off"):
        opened("-i", "socketcan", "-c", "can0")


# Any interface of python-can


def test_every_option_reaches_a_plugin() -> None:
    arguments = ("-i", "adapter", "-c", "x", "-b", "250000", "--fd", "--data-bitrate", "2000000")
    found = opened(*arguments, "--bus-kwargs", "listen_only=True", "serial=17")
    assert found.description == "adapter x (from the command line)"
    assert (found.channel, found.driver, found.is_socketcan) == ("x", PYTHON_CAN, False)
    (options,) = Adapter.opened_with
    assert (
        options.items()
        >= {
            "channel": "x",
            "bitrate": 250000,
            "fd": True,
            "data_bitrate": 2000000,
            "listen_only": True,
            "serial": 17,
        }.items()
    )


def test_a_plugin_that_filters_is_given_what_the_node_receives() -> None:
    assert bus_of(opened("-i", "filtering", "-c", "x")).hardware_filters == FILTERS
    assert bus_of(opened("-i", "filtering", "-c", "x", ids=None)).hardware_filters is None


@pytest.fixture
def plain() -> Iterator[Connection]:
    parser = argparse.ArgumentParser()
    add_bus_arguments(parser)
    found = open_port(parser.parse_args(["-i", "adapter", "-c", "x"]), IDS)
    yield found
    found.port.shutdown()


def test_a_plugin_that_does_not_filter_keeps_its_error_frames(plain: Connection) -> None:
    message = can.Message(arbitration_id=0x40, is_error_frame=True, is_extended_id=False)
    bus_of(plain).waiting.append(message)
    received = plain.port.recv(0.0)
    assert received is not None
    assert received.frame == Frame(0x40, b"", ERROR)


# What comes back


def test_a_frame_that_an_adapter_echoes_is_dropped_and_others_are_not() -> None:
    port: Any = opened("-i", "adapter", "-c", "x").port
    sent, foreign = Frame(0x100, b"\x01"), Frame(0x201, b"\x02")
    assert port.send(sent)
    assert port.send(sent)
    echo, unmarked, other = message_of(sent), message_of(sent), message_of(foreign)
    echo.is_rx = False
    port.bus.waiting = [echo, other]
    assert port.recv(0.0).frame == foreign
    assert port.send(sent)
    port.bus.waiting = [unmarked, message_of(sent)]
    # Once for each sent: whoever sends a copy is somebody else.
    assert port.recv(0.0).frame == sent
    assert port.recv(0.0) is None
