"""Error frames of SocketCAN: what a CAN controller reports of the bus.

Classes are bits of the identifier, details bits of the payload (linux/can/error.h). They are the
same through ``AF_CAN`` and through python-can's ``socketcan``; other interfaces of python-can have
their own codes.
"""

from ..frame import ERROR, Frame

BUS_OFF = "bus_off"
FORGED_BUS_OFF = "forged_bus_off"
"""An error frame reports bus-off, but according to the kernel the controller is not."""
UNSPECIFIED = "unspecified"
"""No bit names a cause; also all error frames of interfaces other than SocketCAN."""

_CONTROLLER, _PROTOCOL, _BUS_OFF, _BUS_ERROR, _RESTARTED = 0x004, 0x008, 0x040, 0x080, 0x100
_CLASSES = (
    (0x001, "transmit_timeout"),
    (0x002, "lost_arbitration"),
    (0x010, "transceiver"),
    (0x020, "no_acknowledge"),
    (_BUS_OFF, BUS_OFF),
    (_BUS_ERROR, "bus_error"),
    (_RESTARTED, "restarted"),
)
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
BIT_ERROR = Frame(_PROTOCOL | _BUS_ERROR, b"\0\0\1\0\0\0\0\0", ERROR)
"""What a recording has of a frame that noise has destroyed."""


def error_causes(frame: Frame) -> tuple[str, ...]:
    """Return all causes that an error frame names, at least UNSPECIFIED."""
    error_class, data = frame.can_id, frame.data.ljust(8, b"\0")
    causes = [cause for bit, cause in _CLASSES if error_class & bit]
    if error_class & _CONTROLLER:
        causes += [cause for bits, cause in _CONTROLLER_DETAILS if data[1] & bits]
    if error_class & _PROTOCOL:
        causes += [cause for bits, cause in _PROTOCOL_DETAILS if data[2] & bits]
        if data[3] in _LOCATIONS_OF_CRC:
            causes.append("crc_error")
    return tuple(causes) or (UNSPECIFIED,)
