"""Error frames of SocketCAN: what a CAN controller reports of the bus, read and written.

Classes are bits of the identifier, details bits of the payload (linux/can/error.h). They are the
same through ``AF_CAN`` and through python-can's ``socketcan``; other interfaces of python-can have
their own codes.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING

from .fault_confinement import ControllerState
from .frame import ERROR, Frame

if TYPE_CHECKING:  # the model of a bus, which no live program needs
    from .bus_errors import ErrorEvent

BUS_OFF = "bus_off"
FORGED_BUS_OFF = "forged_bus_off"
"""An error frame reports bus-off, but according to the kernel the controller is not."""
RESTARTED = "restarted"
UNSPECIFIED = "unspecified"
"""No bit names a cause; also all error frames of interfaces other than SocketCAN."""

_CLASSES = (
    (0x001, "transmit_timeout"),
    (0x002, "lost_arbitration"),
    (0x010, "transceiver"),
    (0x020, "no_acknowledge"),
    (0x040, BUS_OFF),
    (0x080, "bus_error"),
    (0x100, RESTARTED),
)
_CONTROLLER, _PROTOCOL = 0x004, 0x008
_CONTROLLER_DETAILS = (  # of byte 1
    (0x01, "receive_overflow"),
    (0x02, "transmit_overflow"),
    (0x04 | 0x08, "error_warning"),
    (0x10 | 0x20, "error_passive"),
    (0x40, "error_active"),
)
_PROTOCOL_DETAILS = (  # of byte 2
    (0x01 | 0x08 | 0x10, "bit_error"),
    (0x02, "form_error"),
    (0x04, "stuff_error"),
    (0x20, "overload"),
)
_LOCATIONS_OF_CRC = (0x08, 0x18)  # byte 3: CRC sequence, CRC delimiter


_COUNTERS = 0x200
_LOCATIONS = {
    "SOF": 0x03, "ID": 0x02, "SRR": 0x04, "RRS": 0x04, "IDE": 0x05, "ID extension": 0x07,
    "RTR": 0x0C, "r1": 0x0D, "r0": 0x09, "FDF": 0x0D, "res": 0x09, "DLC": 0x0B, "data": 0x0A,
    "CRC": 0x08, "stuff count": 0x08, "CRC delimiter": 0x18, "ACK": 0x19, "ACK delimiter": 0x1B,
    "EOF": 0x1A,
}  # fmt: skip
"""Byte 3, by the field's name in ``frame_on_wire``."""
_STATE_BITS = {
    ControllerState.ERROR_ACTIVE: 0x40,
    ControllerState.ERROR_WARNING: 0x08,
    ControllerState.ERROR_PASSIVE: 0x20,
    ControllerState.BUS_OFF: 0x00,
}


def error_frame(event: "ErrorEvent") -> Frame:
    """Return what SocketCAN reports of an error to the sender of the destroyed frame."""
    data = bytearray(8)
    data[6:] = min(event.transmit_errors, 255), min(event.receive_errors, 255)
    classes = _COUNTERS | (0x002 if event.cause == "arbitration lost" else _PROTOCOL | 0x080)
    if classes & _PROTOCOL:
        data[2], data[3] = 0x01, _LOCATIONS.get(event.field, 0)
    if event.field == "ACK":
        classes |= 0x020
    if event.state is ControllerState.BUS_OFF:
        classes |= 0x040
    elif event.has_changed:
        classes |= _CONTROLLER
        data[1] = _STATE_BITS[event.state]
    return Frame(classes, bytes(data), ERROR)


def error_causes(frame: Frame) -> tuple[str, ...]:
    """Return all causes that an error frame names, at least UNSPECIFIED."""
    return tuple(_causes(frame.can_id, frame.data.ljust(8, b"\0"))) or (UNSPECIFIED,)


def _causes(error_class: int, data: bytes) -> Iterator[str]:
    for bit, cause in _CLASSES:
        if error_class & bit:
            yield cause
    if error_class & _CONTROLLER:
        for bits, cause in _CONTROLLER_DETAILS:
            if data[1] & bits:
                yield cause
    if error_class & _PROTOCOL:
        for bits, cause in _PROTOCOL_DETAILS:
            if data[2] & bits:
                yield cause
        if data[3] in _LOCATIONS_OF_CRC:
            yield "crc_error"
