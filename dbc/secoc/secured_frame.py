"""The authenticated form of our messages: CAN FD frames with the message's own payload in front.

    every message of the nodes but the five below, 20 bytes

        bytes 0 to 7    payload, as in the classic frame: E2E header and signals
        bytes 8 to 11   freshness counter, its lowest 32 bits
        bytes 12 to 19  CMAC, its highest 64 bits

    STEERING_PLAN and PATH_AHEAD, 64 bytes

        bytes 0 to 47   payload
        bytes 48 to 51  freshness counter, its lowest 32 bits
        bytes 52 to 63  CMAC, its highest 96 bits

    CONTROLLER_STATUS, PLANT_STATUS and HAND_WHEEL_STATUS, which synchronise the freshness, 48 bytes

        bytes 0 to 7    payload, as in the classic frame
        bytes 8 to 15   challenge: the number that frames of this sender are bound to
        bytes 16 to 23  echo: the challenge that this message answers
        bytes 24 to 31  freshness counter, all 64 bits
        bytes 32 to 47  CMAC, all 128 bits

The order payload, freshness, authenticator and the high byte first are those of AUTOSAR SecOC, as
``cantools.autosar.secoc`` packs them. ``dbc.secoc.authentication`` makes and checks these frames.
This module contains the parts that need neither key nor cryptography.
"""

from collections.abc import Mapping
from enum import StrEnum
from typing import NamedTuple

from ...runtime.frame import BITRATE_SWITCH, FD, Frame
from ..messages import (
    CAN_IDS,
    CODECS,
    DATA_IDS,
    ControllerStatus,
    HandWheelStatus,
    Message,
    PathAhead,
    PlantStatus,
    SteeringPlan,
    frame_of,
)

PAYLOAD_LENGTH = 8
CHALLENGE_LENGTH = 8
"""Length of a challenge and of its echo [bytes]."""
COUNTER_BITS = 64


class Layout(NamedTuple):
    """Places of the parts of a secured frame.

    ``payload_length``  of the message itself [bytes]
    ``secured_length``  bytes covered by the CMAC, from the first up to the freshness [bytes]
    ``counter_length``  of the freshness counter on the wire [bytes]
    ``mac_length``      of the CMAC on the wire [bytes]
    """

    payload_length: int
    secured_length: int
    counter_length: int
    mac_length: int

    @property
    def mac_start(self) -> int:
        """First byte of the CMAC."""
        return self.secured_length + self.counter_length

    @property
    def length(self) -> int:
        """Length of the whole payload [bytes]."""
        return self.mac_start + self.mac_length


DATA = Layout(PAYLOAD_LENGTH, PAYLOAD_LENGTH, 4, 8)
SYNC = Layout(PAYLOAD_LENGTH, PAYLOAD_LENGTH + 2 * CHALLENGE_LENGTH, 8, 16)
_LONG_LENGTH = CODECS[SteeringPlan].length
LONG = Layout(_LONG_LENGTH, _LONG_LENGTH, 4, 12)
"""Its CMAC is longer, because CAN FD has no length between 48 and 64 bytes."""

STATUS_SENT_BY: Mapping[str, type[Message]] = {
    "PLANT": PlantStatus,
    "CONTROLLER": ControllerStatus,
    "HAND_WHEEL": HandWheelStatus,
}
"""Sent ten times a second by each node of the DBC, whatever it is doing."""
_LONGER = {**dict.fromkeys(STATUS_SENT_BY.values(), SYNC), SteeringPlan: LONG, PathAhead: LONG}
LAYOUTS: Mapping[int, Layout] = {
    can_id: _LONGER.get(message_type, DATA)
    for message_type, can_id in CAN_IDS.items()
    if message_type in DATA_IDS
}
"""By identifier. What a tool sends is written by hand and has no secured form."""


class Refused(StrEnum):
    """Why a frame is not accepted as new and from a sender with the key."""

    UNAUTHENTICATED = "unauthenticated"
    """Not in the secured form: classic, or of another length."""
    FORGED = "forged"
    """The CMAC is not that of this content, identifier, key and freshness."""
    REPLAYED = "replayed"
    """Authentic, but not newer than the newest accepted frame of its identifier."""
    UNSYNCHRONISED = "unsynchronised"
    """Its sender has not yet answered the challenge of this end, or not yet received any."""
    NO_KEY = "no_key"
    """A secured frame, but this end has no key to check it."""


def is_secured(frame: Frame) -> bool:
    """Whether ``frame`` has the secured form of one of our messages; its CMAC is not checked."""
    can_id, data, flags = frame
    if flags & ~BITRATE_SWITCH != FD:
        return False
    layout = LAYOUTS.get(can_id)
    return layout is not None and len(data) == layout.length


def plain(frame: Frame) -> Frame:
    """The plain frame in a secured one, which is NOT verified; any other frame as it is.

    For passive receivers: recordings, the monitor.
    """
    if not is_secured(frame):
        return frame
    return frame_of(frame.can_id, frame.data[: LAYOUTS[frame.can_id].payload_length])
