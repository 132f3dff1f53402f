"""Port of a node to its bus, with receive filters.

A SocketCAN interface is opened by ``runtime.port.socketcan``, without python-can, unless the
configuration needs something that only python-can's ``socketcan`` has.
python-can opens every other interface.
"""

import argparse
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import can
from can.typechecking import CanFilter
from can.util import load_config

from ..bus_model.socketcan_error_frames import BUS_OFF, FORGED_BUS_OFF, UNSPECIFIED, error_causes
from ..exit_status import BusError, cause_of
from ..frame import ERROR, Frame
from ..node.real_time_loop import Received
from .interface_choice import Choice, choose_bus, has_carrier
from .python_can import BusPort, ClosablePort, check_openable, open_bus
from .socketcan import SocketCanPort

AF_CAN, PYTHON_CAN = "AF_CAN", "python-can"
"""Drivers of a port, for the report."""
_FAST_PATH_TAKES = {
    *("interface", "channel", "fd", "can_filters", "single_handle"),
    # python-can's socketcan accepts these too, and leaves them to ``ip link``.
    *("bitrate", "data_bitrate", "timing"),
}


class Connection:
    """An open port of a node; counts its error frames, and ends with the bus.

    In bus-off the CAN controller has switched itself off. A bus-off of a network interface that has
    its carrier is forged, and only counted: any program on the machine can send that error frame.

    ``port``          shut down with the connection
    ``description``   what was opened, and where the choice came from
    ``channel``       its name, for recordings
    ``driver``        AF_CAN or PYTHON_CAN
    ``is_socketcan``  whether the channel is a network interface, with its carrier and error frames
    ``hint``          what a user of this bus should know; empty for nothing
    """

    def __init__(
        self,
        port: ClosablePort,
        description: str,
        channel: str,
        driver: str,
        *,
        is_socketcan: bool,
        hint: str = "",
    ) -> None:
        self.port, self.description, self.channel = port, description, channel
        self.driver, self.is_socketcan, self.hint = driver, is_socketcan, hint
        self._error_frames: Counter[str] = Counter()

    def report(self) -> Mapping[str, Any]:
        """Return error frames by cause, and frames for which the receiving socket had no room."""
        return {
            "driver": self.driver,
            "error_frames": dict(sorted(self._error_frames.items())),
            "frames_dropped": int(getattr(self.port, "dropped", 0)),
        }

    def recv(self, timeout_s: float) -> Received | None:
        """Return the next frame, or None when none comes within ``timeout_s`` [s].

        Error frames are returned too. Raises BusError when the bus is lost.
        """
        received = self.port.recv(timeout_s)
        if received is not None and received.frame.flags & ERROR:
            self._count(received.frame)
        return received

    def send(self, frame: Frame) -> bool:
        """Send ``frame``; returns whether the bus had room. Raises BusError when it is lost."""
        return self.port.send(frame)

    def shutdown(self) -> None:
        """Leave the bus; raises what the port raises."""
        self.port.shutdown()

    def _count(self, error_frame: Frame) -> None:
        causes = error_causes(error_frame) if self.is_socketcan else (UNSPECIFIED,)
        is_off = BUS_OFF in causes
        if is_off and has_carrier(self.channel):
            causes = tuple(FORGED_BUS_OFF if one == BUS_OFF else one for one in causes)
            is_off = False
        self._error_frames.update(causes)
        if is_off:
            raise BusError(
                "bus-off: the CAN controller has switched itself off after too many errors"
            )


VIRTUAL_HINT = (
    "python-can's virtual bus ends at this process: no other program is on it."
    " Two programs meet on -i emulated"
)


def open_port(namespace: argparse.Namespace, can_ids: Collection[int] | None = None) -> Connection:
    """Open the port that the parsed command line, the configuration or this machine asks for.

    ``can_ids``  11-bit identifiers to receive; None: all. Filters in python-can's configuration
                 override them. An interface that cannot filter receives everything, because
                 python-can's own filter would drop error frames too

    Raises BusError.
    """
    filters: list[CanFilter] | None = None
    if can_ids is not None:
        filters = [{"can_id": one, "can_mask": 0x7FF, "extended": False} for one in sorted(can_ids)]
    choice = choose_bus(namespace)
    is_socketcan = choice.interface == "socketcan"
    if is_socketcan and choice.channel:
        config = _configuration(namespace, choice)
        if config is not None and set(config) <= _FAST_PATH_TAKES:
            port = _open_fast(choice, choice.channel, config, filters)
            description = f"SocketCAN {choice.channel} by {AF_CAN} ({choice.reason})"
            return Connection(port, description, choice.channel, AF_CAN, is_socketcan=True)
    bus, description = open_bus(namespace, choice)
    # Whether the interface, its driver or its hardware filters, instead of python-can.
    filters_itself = type(bus)._apply_filters is not can.BusABC._apply_filters
    if filters is not None and bus.filters is None and filters_itself:
        bus.set_filters(filters)
    channel = choice.channel or str(getattr(bus, "channel", None) or "can0")
    hint = VIRTUAL_HINT if choice.interface == "virtual" else ""
    return Connection(
        BusPort(bus), description, channel, PYTHON_CAN, is_socketcan=is_socketcan, hint=hint
    )


def _open_fast(
    choice: Choice, channel: str, config: Mapping[str, Any], filters: Sequence[CanFilter] | None
) -> SocketCanPort:
    check_openable(choice)
    try:
        return SocketCanPort(
            channel, config.get("can_filters") or filters, fd=bool(config.get("fd"))
        )
    except (OSError, ValueError) as error:
        raise BusError(f"cannot open {choice.name} ({choice.reason}): {cause_of(error)}") from error


def _configuration(namespace: argparse.Namespace, choice: Choice) -> Mapping[str, Any] | None:
    """Return python-can's configuration of the bus; None if it has mistakes, which it reports."""
    given = {
        key: value
        for key, value in vars(namespace).items()
        if key in ("fd", "bitrate", "data_bitrate", "timing", "can_filters")
    }
    given |= {"interface": choice.interface, "channel": choice.channel}
    given |= getattr(namespace, "bus_kwargs", {})
    try:
        return dict(load_config(config=given))
    except (can.CanError, ValueError, TypeError):
        return None
