"""The messages on the bus as typed records, to and from frames.

Units are SI and the last part of a field's name; signs are ISO 8855 (x forward, y left; left is
positive). What each field means, its range and its resolution are in ``steer_by_wire.dbc``.

Encoding raises for a value that its signal cannot carry, which is a mistake of the program.
Decoding never raises: a frame that is not a valid message gives a ``Rejection``, to be counted by
cause.

``dbc.generated_layout`` is the DBC as records, so that a node needs no reader of DBC files.
"""

import re
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple, TypeAlias, get_args

from ..runtime.frame import ERROR, EXTENDED, REMOTE, Frame
from ..runtime.record import new_record
from .codec import EncodeError, Rejection, codecs_of
from .enumerations import (
    ControllerFault,
    Direction,
    EchoState,
    EstimateState,
    Freshness,
    LatencyModel,
    Law,
    Mode,
    MotionRequest,
    SafetyState,
    SecondSender,
    SteeringStatusCode,
    Validity,
)
from .generated_layout import LAYOUTS
from .long_messages import PathAhead, SteeringPlan
from .protection import is_intact
from .signals import SignalRange

__all__ = [
    "CAN_IDS",
    "COMMAND_COUNTERS",
    "CYCLE_TIMES_MS",
    "DATA_IDS",
    "MESSAGE_TYPES",
    "ControllerFault",
    "ControllerSafety",
    "ControllerStatus",
    "Decoded",
    "DelayStatus",
    "Direction",
    "DisturbanceConfig",
    "EchoState",
    "EncodeError",
    "EstimateState",
    "Freshness",
    "GroundTruth",
    "LatencyConfig",
    "LatencyModel",
    "LateralError",
    "Law",
    "Message",
    "Mode",
    "MotionRequest",
    "PathAhead",
    "PlantStatus",
    "Rejection",
    "SafetyState",
    "SecondSender",
    "SignalRange",
    "SteeringCommand",
    "SteeringPlan",
    "SteeringStatus",
    "SteeringStatusCode",
    "Validity",
    "VehicleState",
    "decode",
    "encode",
    "encode_not_available",
    "frame_of",
    "limits",
    "packing",
    "rejection_of",
    "resolutions",
    "unpacking",
]


class SteeringCommand(NamedTuple):
    """Controller to plant, every control period."""

    steer_rad: float
    command_counter: int
    mode: Mode


class LateralError(NamedTuple):
    """Plant to controller: deviation from the path at the preview point."""

    lateral_error_m: float
    heading_error_rad: float


class SteeringStatus(NamedTuple):
    """Plant to controller: ``applied_counter`` is the command_counter of the command in effect."""

    wheel_angle_rad: float
    applied_counter: int
    status: SteeringStatusCode


class VehicleState(NamedTuple):
    """Plant to controller: motion, and the path's curvature at the preview point."""

    speed_m_s: float
    yaw_rate_rad_s: float
    preview_curvature_1_m: float


class ControllerStatus(NamedTuple):
    """Controller to all, for monitoring; ``skipped_ticks`` is modulo 256."""

    mode: Mode
    law: Law
    disturbance_rad: float
    network_disturbance_rad: float
    skipped_ticks: int


class ControllerSafety(NamedTuple):
    """Controller to all, for monitoring: refused frames, missing messages, and its own faults.

    ``rejected`` and ``lost`` are modulo 4096.
    """

    rejected: int
    lost: int
    lateral_error_freshness: Freshness
    steering_status_freshness: Freshness
    vehicle_state_freshness: Freshness
    fault: ControllerFault
    second_sender: SecondSender = SecondSender.NONE
    validity: Validity = Validity.UNKNOWN
    motion_request: MotionRequest = MotionRequest.NONE


class DelayStatus(NamedTuple):
    """Controller to all, for monitoring: the delay from command to measurement, down and up."""

    echo_delay_s: float
    estimated_delay_s: float
    echo_state: EchoState
    estimate_state: EstimateState
    confidence: float


class PlantStatus(NamedTuple):
    """Plant to all, for monitoring; ``lost`` is modulo 64 and ``rejected`` modulo 32."""

    downlink_latency_s: float
    uplink_latency_s: float
    lost: int
    rejected: int
    safety: SafetyState = SafetyState.NORMAL
    second_sender: SecondSender = SecondSender.NONE


class GroundTruth(NamedTuple):
    """Plant to all, optional, for monitoring: ``cg_deviation_m`` is of the centre of gravity."""

    cg_deviation_m: float


class LatencyConfig(NamedTuple):
    """Any tool to plant: the latency from now on; ``spread_s`` is the standard deviation."""

    direction: Direction
    model: LatencyModel
    mean_s: float
    spread_s: float
    loss: float


class DisturbanceConfig(NamedTuple):
    """Any tool to plant: the disturbances from now on, in place of those of the settings.

    ``friction_loss``  share of both cornering stiffnesses that is missing
    """

    side_force_n: float
    yaw_moment_n_m: float
    steering_offset_rad: float
    friction_loss: float


Message: TypeAlias = (
    SteeringCommand
    | SteeringPlan
    | LateralError
    | SteeringStatus
    | VehicleState
    | PathAhead
    | ControllerStatus
    | ControllerSafety
    | DelayStatus
    | PlantStatus
    | GroundTruth
    | LatencyConfig
    | DisturbanceConfig
)

MESSAGE_TYPES: Mapping[str, type[Message]] = MappingProxyType(
    {re.sub(r"(?<=[a-z])(?=[A-Z])", "_", kind.__name__).upper(): kind for kind in get_args(Message)}
)
"""The name of each message in the DBC, and its Python type."""


class Decoded(NamedTuple):
    """A received message and its E2E counter (0 to 255; 0 for one without protection)."""

    message: Message
    counter: int


_CODECS = codecs_of(LAYOUTS, MESSAGE_TYPES.items())
_CODECS_BY_ID = {codec.can_id: codec for codec in _CODECS.values()}

CAN_IDS: Mapping[type[Message], int] = MappingProxyType(
    {message_type: codec.can_id for message_type, codec in _CODECS.items()}
)
"""The identifier each message is sent under."""

DATA_IDS: Mapping[type[Message], int] = MappingProxyType(
    {kind: codec.data_id for kind, codec in _CODECS.items() if codec.data_id is not None}
)
"""The E2E Data ID of each message that is protected: all but those sent by hand, by a tool."""

CYCLE_TIMES_MS: Mapping[type[Message], int] = MappingProxyType(
    {message_type: codec.cycle_time_ms for message_type, codec in _CODECS.items()}
)
"""How often each message is sent at the default rates [ms]; 0 for one sent when needed, and for
SteeringPlan, which takes the place of SteeringCommand.

One that is sent cyclically and spontaneously comes in between as well, at changes.
"""


def limits(message_type: type[Message]) -> Mapping[str, SignalRange]:
    """The range of each field of ``message_type``, so that a node can clamp to it."""
    return MappingProxyType(_CODECS[message_type].limits)


def resolutions(message_type: type[Message]) -> Mapping[str, float]:
    """The resolution of each field of ``message_type``."""
    return MappingProxyType(_CODECS[message_type].resolutions)


COMMAND_COUNTERS = int(limits(SteeringCommand)["command_counter"].maximum) + 1
"""Number of values of a command's counter, which wraps and is independent of the E2E counter."""


class Unpacking(NamedTuple):
    """How to read a frame of one message: length, flags, and ``MessageCodec.unpack``."""

    length: int
    flags: int
    unpack: Callable[[bytes], tuple[Message, int] | Rejection]


def unpacking(message_type: type[Message]) -> Unpacking:
    """Return how to read the payload of a message, for a receiver of many frames."""
    codec = _CODECS[message_type]
    return Unpacking(codec.length, codec.flags, codec.unpack)


class Packing(NamedTuple):
    """How to send one message: identifier, ``MessageCodec.pack``, format as in ``Frame``."""

    can_id: int
    pack: Callable[[Any, int], bytes]
    flags: int


def packing(message_type: type[Message]) -> Packing:
    """Return how to send a message, for a sender of many frames."""
    codec = _CODECS[message_type]
    return Packing(codec.can_id, codec.pack, codec.flags)


def encode(message: Message, counter: int) -> Frame:
    """The frame for ``message``; a value is rounded to the signal's resolution.

    ``counter`` is the E2E counter, 0 to 255, one more for each frame of this type; one without
    protection ignores it. Raises EncodeError for a value outside its signal's range, a value that
    is not finite, and a member of the wrong enum.
    """
    codec = _CODECS[type(message)]
    return new_record(Frame, (codec.can_id, codec.pack(message, counter), codec.flags))


def frame_of(can_id: int, payload: bytes) -> Frame:
    """Return the frame that carries the payload of one of our messages, in its format."""
    return Frame(can_id, payload, _CODECS_BY_ID[can_id].flags)


def encode_not_available(message: Message, counter: int) -> Frame:
    """The frame for ``message`` with "no value now" in every signal that has such a raw.

    These are ``steer_rad`` of SteeringCommand and both fields of LateralError; the others are sent
    as they are in ``message``. Raises EncodeError as ``encode`` does, and for the other types.
    """
    codec = _CODECS[type(message)]
    return Frame(codec.can_id, codec.pack_not_available(message, counter))


def decode(frame: Frame) -> Decoded | Rejection:
    """The message in ``frame``, or why there is none; never raises."""
    can_id, data, flags = frame
    codec = _CODECS_BY_ID.get(can_id)
    if codec is None or flags != codec.flags or len(data) != codec.length:
        return rejection_of(frame)
    unpacked = codec.unpack(data)
    if isinstance(unpacked, Rejection):
        return rejection_of(frame)
    return new_record(Decoded, unpacked)


def rejection_of(frame: Frame) -> Rejection:
    """Why ``frame``, which is not a valid message, is rejected."""
    can_id, data, flags = frame
    if flags & ERROR:  # its identifier is an error class and may equal one of ours
        return Rejection.WRONG_FORMAT
    codec = _CODECS_BY_ID.get(can_id)
    if codec is None:
        return Rejection.UNKNOWN_ID
    if flags & (EXTENDED | REMOTE):
        return Rejection.WRONG_FORMAT
    if len(data) != codec.length:
        return Rejection.WRONG_LENGTH
    unpacked = codec.unpack(data)
    if flags != codec.flags or not isinstance(unpacked, Rejection):  # the length happens to fit
        return Rejection.WRONG_FORMAT
    if unpacked is Rejection.BAD_CRC and any(is_intact(data, other) for other in DATA_IDS.values()):
        return Rejection.MASQUERADED
    return unpacked
