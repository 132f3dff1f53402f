"""Choice of the CAN interface that a program opens, by python-can's own conventions.

It comes from the first of these that names one:

1. the command line (``add_bus_arguments``: python-can's own options, as ``can.logger`` has them)
2. ``can.rc``, CAN_INTERFACE, CAN_CHANNEL, CAN_BITRATE, CAN_CONFIG and the configuration files of
   python-can
3. when none of them names an interface: ``socketcan``, if this machine has the channel (``vcan0``
   unless given) as a CAN network interface that is up; else ``emulated``
"""

import argparse
import configparser
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple, cast

import can
import can.cli
from can.util import load_environment_config, load_file_config

from ..exit_status import BusError, one_line

AUTO_CHANNEL = "vcan0"
"""Where no channel is given."""
_BUS_HELP: Mapping[str, tuple[str, ...]] = {
    "--interface": ("socketcan, emulated, slcan, pcan, ... (default: as available)", "NAME"),
    "--channel": ("channel of the interface (default: vcan0)", "NAME"),
    "--bitrate": ("bit rate, if the interface can set it", "BIT_S"),
    "--fd": ("use CAN FD",),
    "--data-bitrate": ("bit rate of the data phase of CAN FD", "BIT_S"),
    "--timing": ("bit timing, such as f_clock=80000000 tseg1=5 tseg2=2 sjw=2 brp=2", "K=V"),
    "--bus-kwargs": ("further arguments of the interface", "K=V"),
}
"""One line of help for each of python-can's options, and the metavar of those with a value."""
_NETWORK_INTERFACES = Path("/sys/class/net")
_ARPHRD_CAN = 280
"""Type of a CAN network interface (linux/if_arp.h)."""
_IFF_UP = 1


class Choice(NamedTuple):
    """An interface and where the choice came from; without a channel, the interface's default."""

    interface: str
    channel: str | None
    reason: str

    @property
    def name(self) -> str:
        """Interface and channel."""
        return " ".join(filter(None, (self.interface, self.channel)))


def add_bus_arguments(parser: argparse.ArgumentParser) -> None:
    """Add python-can's options: interface, channel, bit rates, FD, timing, bus arguments."""
    can.cli.add_bus_arguments(cast(argparse.ArgumentParser, _BriefGroup(parser)))


class _BriefGroup:
    """Adds python-can's options with one line of help each instead of its paragraphs."""

    def __init__(self, parser: argparse.ArgumentParser) -> None:
        self._group = parser.add_argument_group("CAN bus, as python-can opens it")

    def add_argument_group(self, _title: str) -> "_BriefGroup":
        """Return the only group."""
        return self

    def add_argument(self, *flags: str, **further: Any) -> None:
        """Add one option."""
        brief = zip(("help", "metavar"), _BUS_HELP.get(flags[-1], ()), strict=False)
        self._group.add_argument(*flags, **{**further, **dict(brief)})


def choose_bus(namespace: argparse.Namespace) -> Choice:
    """Return what the parsed command line, the configuration or this machine asks to open.

    Raises BusError.
    """
    files = [file for file in can.util.CONFIG_FILES if Path(file).expanduser().exists()]
    sources: tuple[tuple[str, Mapping[str, Any]], ...] = (
        ("command line", vars(namespace)),
        ("can.rc", can.rc),
        ("environment", _configured("CAN_CONFIG", load_environment_config)),
        ("configuration file", _configured(" and ".join(files) or "none", load_file_config)),
    )
    channel = next((str(found["channel"]) for _, found in sources if found.get("channel")), None)
    for reason, found in sources:
        if found.get("interface"):
            return Choice(str(found["interface"]), channel, f"from the {reason}")
    wanted = channel or AUTO_CHANNEL
    obstacle = socketcan_obstacle(wanted)
    if obstacle:
        return Choice("emulated", channel, f"no interface was given, and {obstacle}")
    return Choice("socketcan", wanted, "no interface was given, and this machine has it")


def _configured(name: str, load: Callable[[], Any]) -> Mapping[str, Any]:
    try:
        found = load()
        if not isinstance(found, Mapping):
            raise ValueError('not a table such as {"interface": "socketcan"}')
    except (ValueError, TypeError, RecursionError, OSError, configparser.Error) as error:
        cause = one_line(error)
        if "\\ufeff" in cause:
            cause = "it begins with a byte order mark; save it as UTF-8 without one"
        raise BusError(f"python-can's configuration, {name}, cannot be read: {cause}") from error
    return found


def socketcan_obstacle(channel: str) -> str:
    """Why ``channel`` cannot be opened as a SocketCAN interface; empty when it can."""
    if sys.platform != "linux":
        return "only Linux has SocketCAN"
    directory = _NETWORK_INTERFACES / channel
    try:
        kind = int((directory / "type").read_text())
        flags = int((directory / "flags").read_text(), 16)
    except OSError:
        return f"this machine has no network interface {channel}"
    if kind != _ARPHRD_CAN:
        return f"the network interface {channel} is not CAN"
    if not flags & _IFF_UP:
        return f"the network interface {channel} is down (ip link set {channel} up)"
    if has_carrier(channel) is False:
        return (
            f"the network interface {channel} has no carrier: it is in bus-off (ip link set "
            f"{channel} down, then up), or its other end is down"
        )
    return ""


def has_carrier(channel: str) -> bool | None:
    """Whether a network interface can send; None if unknown.

    A CAN controller has no carrier from bus-off until its restart.
    """
    try:
        return (_NETWORK_INTERFACES / channel / "carrier").read_text().strip() == "1"
    except OSError:  # the interface is down or missing
        return None
