"""Opens the bus for a node, with receive filters.

A SocketCAN interface is opened by ``runtime.port.socketcan``, without python-can, unless the
configuration needs something that only python-can's ``socketcan`` has.
python-can opens every other interface.
"""

import argparse
from collections.abc import Collection, Mapping, Sequence
from typing import Any, NamedTuple

import can
from can.typechecking import CanFilter
from can.util import load_config

from ..exit_status import BusError, cause_of
from .interface_choice import Choice, choose_bus
from .python_can import BusPort, ClosablePort, check_openable, open_bus
from .socketcan import SocketCanPort

AF_CAN, PYTHON_CAN = "AF_CAN", "python-can"
"""Drivers of a port, for the report."""
_FAST_PATH_TAKES = {
    *("interface", "channel", "fd", "can_filters", "single_handle"),
    # python-can's socketcan accepts these too, and leaves them to ``ip link``.
    *("bitrate", "data_bitrate", "timing"),
}


class OpenPort(NamedTuple):
    """An open port.

    ``port``          the caller shuts it down
    ``description``   what was opened, and where the choice came from
    ``channel``       its name, for recordings
    ``driver``        AF_CAN or PYTHON_CAN
    ``is_socketcan``  whether its error frames have SocketCAN's codes
    ``has_carrier``   whether the channel is a network interface, whose carrier shows bus-off too
    ``hint``          what a user of this bus should know; empty for nothing
    """

    port: ClosablePort
    description: str
    channel: str
    driver: str
    is_socketcan: bool
    has_carrier: bool = True
    hint: str = ""


VIRTUAL_HINT = (
    "python-can's virtual bus ends at this process: no other program is on it."
    " Two programs meet on -i emulated"
)


def open_port(namespace: argparse.Namespace, can_ids: Collection[int] | None = None) -> OpenPort:
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
            return OpenPort(port, description, choice.channel, AF_CAN, is_socketcan)
    bus, description = open_bus(namespace, choice)
    # Whether the interface, its driver or its hardware filters, instead of python-can.
    filters_itself = type(bus)._apply_filters is not can.BusABC._apply_filters
    if filters is not None and bus.filters is None and filters_itself:
        bus.set_filters(filters)
    channel = choice.channel or str(getattr(bus, "channel", None) or "can0")
    means_the_same = is_socketcan or choice.interface == "emulated"
    return OpenPort(
        BusPort(bus),
        description,
        channel,
        PYTHON_CAN,
        means_the_same,
        is_socketcan,
        VIRTUAL_HINT if choice.interface == "virtual" else "",
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
