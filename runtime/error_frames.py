"""Error frames of SocketCAN, in which the local CAN controller reports the state of the bus.

Classes are bits of the identifier, details bits of the payload (linux/can/error.h). They are the
same through ``AF_CAN`` and through python-can's ``socketcan``; other interfaces of python-can have
their own codes.
"""

from collections.abc import Iterator

from .frame import Frame

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
