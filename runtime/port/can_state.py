"""The state of a CAN controller according to the kernel, by netlink (rtnetlink(7)).

Any program on the machine can send an error frame that reports bus-off, and the others receive it
as if it came from a controller. The kernel's own answer cannot be forged.
"""

import socket
import struct
import sys
from collections.abc import Callable, Iterator

# linux/netlink.h, linux/rtnetlink.h, linux/if_link.h, linux/can/netlink.h
_RTM_NEWLINK, _RTM_GETLINK, _NLM_F_REQUEST = 16, 18, 1
_IFLA_LINKINFO, _IFLA_INFO_KIND, _IFLA_INFO_DATA, _IFLA_CAN_STATE = 18, 1, 2, 4
_CAN_STATE_BUS_OFF, _CAN_STATE_STOPPED = 3, 4
_STATELESS_KINDS = (b"vcan", b"vxcan")
"""Virtual interfaces, which have no controller."""
_HEADER = struct.Struct("=IHHII")
_LINK = struct.Struct("=BxHiII")
_ATTRIBUTE = struct.Struct("=HH")
_TYPE_MASK = 0x3FFF
_ANSWER_BYTES_MAX = 1 << 16
_TIMEOUT_S = 0.1
"""The kernel answers before ``send`` returns."""


def is_in_bus_off(channel: str, ask: Callable[[bytes], bytes] | None = None) -> bool | None:
    """Whether the controller of a network interface is in bus-off, or was stopped after it.

    False also for a virtual interface; None if the kernel gives no state.

    ``ask``  passes a request to the kernel and returns its answer; raises OSError
    """
    try:
        request = _request(socket.if_nametoindex(channel))
        return _is_in_bus_off((ask or _ask_kernel)(request))
    except (OSError, AttributeError, struct.error):  # AttributeError: only Linux has netlink
        return None


def _request(index: int) -> bytes:
    """Return the request for the attributes of one network interface."""
    link = _LINK.pack(0, 0, index, 0, 0)
    return _HEADER.pack(_HEADER.size + len(link), _RTM_GETLINK, _NLM_F_REQUEST, 1, 0) + link


def _ask_kernel(request: bytes) -> bytes:
    with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, socket.NETLINK_ROUTE) as kernel:
        kernel.settimeout(_TIMEOUT_S)
        kernel.bind((0, 0))
        kernel.sendto(request, (0, 0))  # port 0 is the kernel
        return kernel.recv(_ANSWER_BYTES_MAX)


def _is_in_bus_off(answer: bytes) -> bool | None:
    """Read the answer; raises struct.error if it is truncated."""
    size, kind, _, _, _ = _HEADER.unpack_from(answer)
    if kind != _RTM_NEWLINK:
        return None
    attributes = dict(_attributes(answer[_HEADER.size + _LINK.size : size]))
    information = dict(_attributes(attributes.get(_IFLA_LINKINFO, b"")))
    if information.get(_IFLA_INFO_KIND, b"").rstrip(b"\0") in _STATELESS_KINDS:
        return False
    state = dict(_attributes(information.get(_IFLA_INFO_DATA, b""))).get(_IFLA_CAN_STATE)
    if state is None:
        return None
    return int.from_bytes(state, sys.byteorder) in (_CAN_STATE_BUS_OFF, _CAN_STATE_STOPPED)


def _attributes(raw: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield type and value of each attribute; raises struct.error if truncated."""
    while raw:
        size, kind = _ATTRIBUTE.unpack_from(raw)
        if not _ATTRIBUTE.size <= size <= len(raw):
            raise struct.error("truncated attribute")
        yield kind & _TYPE_MASK, raw[_ATTRIBUTE.size : size]
        raw = raw[-(-size // 4) * 4 :]
