"""Opens any python-can interface by python-can's own conventions, and is a node's port to it.

Nodes open their bus with ``runtime.port.port``, which has a faster way for SocketCAN. The interface
comes from the first of these that names one:

1. the command line (``add_bus_arguments``: python-can's own options, as ``can.logger`` has them)
2. ``can.rc``, CAN_INTERFACE, CAN_CHANNEL, CAN_BITRATE, CAN_CONFIG and the configuration files of
   python-can
3. when none of them names an interface: ``socketcan``, if this machine has the channel (``vcan0``
   unless given) as a CAN network interface that is up; else ``emulated``
"""

import argparse
import errno
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple, Protocol, cast

import can
import can.cli
from can.util import load_environment_config, load_file_config

from ..exit_status import ExitStatus, UserError, one_line
from ..frame import Frame
from ..frame.message import frame_of, message_of
from ..node.real_time_loop import Received

_AUTO_CHANNEL = "vcan0"
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
_SENT_MAX = 64
"""Most frames on their way back to their sender: 16 ms of a 500 kbit/s bus of its own."""
_FULL_CODES = {
    "PcanCanOperationError": (0x01, 0x80),  # PCAN_ERROR_XMTFULL, PCAN_ERROR_QXMTFULL
    "CANLIBOperationError": (-13,),  # Kvaser: canERR_TXBUFOFL
    "VectorOperationError": (11,),  # XL_ERR_QUEUE_IS_FULL
}
"""Codes of drivers whose transmit queue is full, by python-can's exception for their failures."""


class BusError(UserError):
    """The bus cannot be opened or has failed; the text is one line for the user."""

    exit_status = ExitStatus.BUS


class OpenBus(NamedTuple):
    """An open bus.

    ``bus``          the caller shuts it down
    ``description``  what was opened, and where the choice came from
    """

    bus: can.BusABC
    description: str


class Choice(NamedTuple):
    """An interface and where the choice came from; without a channel, the interface's default."""

    interface: str
    channel: str | None
    reason: str

    @property
    def name(self) -> str:
        """Interface and channel."""
        return " ".join(filter(None, (self.interface, self.channel)))


class Closable(Protocol):
    """Anything that has to be shut down."""

    def shutdown(self) -> None:
        """Release its resources."""
        ...


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
    try:
        return _choose(namespace)
    except ValueError as error:
        raise BusError(f"python-can's configuration cannot be read: {one_line(error)}") from error


def open_bus(namespace: argparse.Namespace, choice: Choice | None = None) -> OpenBus:
    """Open the bus that the parsed command line, the configuration or this machine asks for.

    ``choice``  from ``choose_bus``; None: is made here

    Raises BusError.
    """
    choice = choice or choose_bus(namespace)
    check_openable(choice)
    given = {"interface": choice.interface, "channel": choice.channel}
    try:
        bus = can.cli.create_bus_from_namespace(namespace, **given)
    except argparse.ArgumentError as error:
        # It wraps any exception of the interface: OSError for a missing SocketCAN interface,
        # ImportError for a missing driver.
        cause = one_line(error.__cause__ or error)
        raise BusError(f"cannot open {choice.name} ({choice.reason}): {cause}") from error
    # Some interfaces of python-can leave channel_info unset.
    what = choice.name if bus.channel_info == can.BusABC.channel_info else bus.channel_info
    return OpenBus(bus, f"{what} ({choice.reason})")


def check_openable(choice: Choice) -> None:
    """Raise BusError if python-can could not open the network interface."""
    if choice.interface == "socketcan":
        # Without a channel python-can opens all of them, and cannot send.
        obstacle = (
            socketcan_obstacle(choice.channel)
            if choice.channel
            else f"no channel was given (such as -c {_AUTO_CHANNEL})"
        )
        if obstacle:
            raise BusError(f"cannot open {choice.name}: {obstacle}")


@contextmanager
def shutting_down(bus: Closable) -> Iterator[None]:
    """Shut ``bus`` down at the end of the block.

    Errors are ignored: a bus that has failed, as after an unplugged adapter, has been reported.
    """
    try:
        yield
    finally:
        with suppress(can.CanError, OSError):
            bus.shutdown()


class BusPort:
    """The python-can ``bus`` as the port of a node's executor; takes and returns frames.

    Some buses deliver to a node what it has sent itself: multicast, and adapters that echo. Such a
    frame is dropped, once for each sent. python-can's ``is_rx`` does not tell: on SocketCAN it is
    false for the frames of every program on this machine.
    """

    def __init__(self, bus: can.BusABC) -> None:
        self.bus = bus
        self._sent: dict[Frame, None] = {}
        """The newest frames sent that have not come back, oldest first."""

    @property
    def takes_fd(self) -> bool:
        """Whether it was opened for CAN FD frames."""
        return self.bus.protocol is not can.CanProtocol.CAN_20

    def recv(self, timeout_s: float) -> Received | None:
        """Return the next frame, or None when none comes within ``timeout_s`` [s].

        A negative ``timeout_s``, of a deadline that has passed, does not wait. Error frames have
        the flag ERROR. The arrival time is None, because the clock of python-can's time stamps
        differs between interfaces. Raises BusError when the bus has failed.
        """
        while True:
            try:
                message = self.bus.recv(max(timeout_s, 0.0))
            except (can.CanError, OSError) as error:
                raise BusError(f"cannot receive: {one_line(error)}") from error
            if message is None:
                return None
            frame = frame_of(message)
            if frame not in self._sent:
                return Received(frame, None)
            del self._sent[frame]
            timeout_s = 0.0

    def send(self, frame: Frame) -> bool:
        """Send ``frame`` without waiting; returns whether the bus had room.

        Raises BusError when the bus has failed.
        """
        try:
            self.bus.send(message_of(frame), timeout=0)
        except (can.CanError, OSError, ValueError) as error:
            if _is_full(error):
                return False
            raise BusError(f"cannot send: {one_line(error)}") from error
        self._sent[frame] = None
        if len(self._sent) > _SENT_MAX:
            del self._sent[next(iter(self._sent))]
        return True

    def shutdown(self) -> None:
        """Shut the bus down."""
        self.bus.shutdown()


def _choose(namespace: argparse.Namespace) -> Choice:
    """Decide what to open; raises ValueError for an unreadable configuration."""
    sources = (
        ("command line", vars(namespace)),
        ("can.rc", can.rc),
        ("environment", load_environment_config()),
        ("configuration file", load_file_config()),
    )
    channel = next((str(found["channel"]) for _, found in sources if found.get("channel")), None)
    for reason, found in sources:
        if found.get("interface"):
            return Choice(found["interface"], channel, f"from the {reason}")
    wanted = channel or _AUTO_CHANNEL
    obstacle = socketcan_obstacle(wanted)
    if obstacle:
        return Choice("emulated", channel, f"no interface was given, and {obstacle}")
    return Choice("socketcan", wanted, "no interface was given, and this machine has it")


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


def _is_full(error: Exception) -> bool:
    """Whether a frame was refused only because the queue is full.

    This is temporary: the bus is overloaded, or no other node acknowledges.
    """
    if isinstance(error, can.CanTimeoutError):
        return True
    code = error.error_code if isinstance(error, can.CanError) else getattr(error, "errno", None)
    if code in _FULL_CODES.get(type(error).__name__, (errno.ENOBUFS, errno.EAGAIN)):
        return True
    # python-can's socketcan gives no code when the queue of the socket is full.
    return "Transmit buffer full" in str(error)
