"""The messages on the bus to and from frames, as the records of ``dbc.contract.message_records``.

Encoding raises for a value that its signal cannot carry, which is a mistake of the program.
Decoding never raises: a frame that is not a valid message gives a ``Rejection``, to be counted by
cause.

``dbc.contract.generated_layout`` is the DBC as records, so that a node needs no reader of DBC
files.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

from ..runtime.fast_named_tuple import new_record
from ..runtime.frame import ERROR, EXTENDED, REMOTE, Frame
from .codec.codec import FILE, MessageCodec, codecs_of
from .codec.codec import EncodeError as EncodeError
from .codec.codec import Rejection as Rejection
from .codec.layout import SignalRange as SignalRange
from .codec.protection import COUNTERS, id_mark, is_masqueraded
from .contract.enumerations import *  # noqa: F403  all are names of this module too
from .contract.generated_layout import LAYOUTS
from .contract.generated_layout import VERSION as VERSION
from .contract.message_records import *  # noqa: F403
from .contract.message_records import MESSAGE_TYPES, Message, SteeringCommand, SteeringPlan


class Decoded(NamedTuple):
    """A received message and its E2E counter (0 to 255; 0 for one without protection)."""

    message: Message
    counter: int


CODECS = codecs_of(LAYOUTS, MESSAGE_TYPES.items())
"""How each message is packed and unpacked."""
_CODECS_BY_ID = {codec.can_id: codec for codec in CODECS.values()}

CAN_IDS: Mapping[type[Message], int] = {
    message_type: codec.can_id for message_type, codec in CODECS.items()
}
"""The identifier each message is sent under."""

_SENDERS = {layout.name: layout.sender for layout in LAYOUTS}


EVENTS = frozenset(kind for name, kind in MESSAGE_TYPES.items() if _SENDERS[name] == "TOOL")
"""Messages of tools, which come and go: each acts by itself, whatever its counter."""


def sent_by(node: str) -> tuple[type[Message], ...]:
    """Return the messages that a node of the DBC alone sends, as CONTROLLER or PLANT."""
    return tuple(kind for name, kind in MESSAGE_TYPES.items() if _SENDERS[name] == node)


DATA_IDS: Mapping[type[Message], int] = {
    kind: codec.data_id for kind, codec in CODECS.items() if codec.data_id is not None
}
"""The E2E Data ID of each message that is protected: all but those sent by hand, by a tool."""
_ID_MARKS = frozenset(map(id_mark, DATA_IDS.values()))
REVISIONS = (0x0800, 0x1000, 0x2000)
"""Bits in which the Data IDs of other major revisions of the DBC differ from those of this one. One
bit is so little that no two flipped bits of a frame look like another revision."""
_REVISION_MARKS = {
    CAN_IDS[kind]: frozenset(id_mark(data_id ^ bit) for bit in REVISIONS)
    for kind, data_id in DATA_IDS.items()
}
OTHER_REVISION_TEXT = (
    f"another program on the bus speaks another revision of {FILE} than this one's {VERSION}: use"
    " one release of both"
)

CYCLE_TIMES_MS: Mapping[type[Message], int] = {
    message_type: codec.layout.cycle_time_ms for message_type, codec in CODECS.items()
}
"""How often each message is sent at the default rates [ms]; 0 for one sent when needed, and for
SteeringPlan, which takes the place of SteeringCommand.

One that is sent cyclically and spontaneously comes in between as well, at changes.
"""

ACTIVE_CYCLE_TIMES_MS: Mapping[type[Message], int] = {
    message_type: codec.layout.active_cycle_time_ms for message_type, codec in CODECS.items()
}
"""Cycle of a message while it is sent, also of one sent when needed [ms]; 0 for those of a tool."""

NUMBERED_WITH: Mapping[type[Message], type[Message]] = {SteeringPlan: SteeringCommand}
"""The message in whose place another is sent: both are one sequence of E2E counters."""


def limits(message_type: type[Message]) -> Mapping[str, SignalRange]:
    """The range of each field of ``message_type``, so that a node can clamp to it."""
    return MappingProxyType(CODECS[message_type].limits)


def resolutions(message_type: type[Message]) -> Mapping[str, float]:
    """The resolution of each field of ``message_type``."""
    return MappingProxyType(CODECS[message_type].resolutions)


COMMAND_COUNTERS = int(limits(SteeringCommand)["command_counter"].maximum) + 1
"""Number of values of a command's counter, which wraps and is independent of the E2E counter."""


def encode(message: Message, counter: int) -> Frame:
    """The frame for ``message``; a value is rounded to the signal's resolution.

    ``counter`` is the E2E counter, 0 to 255, one more for each frame of this type; one without
    protection ignores it. Raises EncodeError for a value outside its signal's range, a value that
    is not finite, and a member of the wrong enum.
    """
    codec = CODECS[type(message)]
    return new_record(Frame, (codec.can_id, codec.pack(message, counter), codec.flags))


def frame_of(can_id: int, payload: bytes) -> Frame:
    """Return the frame that carries the payload of one of our messages, in its format."""
    return Frame(can_id, payload, _CODECS_BY_ID[can_id].flags)


def encode_not_available(message: Message, counter: int) -> Frame:
    """The frame for ``message`` with "no value now" in every signal that has such a raw.

    These are ``steer_rad`` of SteeringCommand and both fields of LateralError; the others are sent
    as they are in ``message``. Raises EncodeError as ``encode`` does, and for the other types.
    """
    codec = CODECS[type(message)]
    return Frame(codec.can_id, codec.pack_not_available(message, counter))


def decode(frame: Frame) -> Decoded | Rejection:
    """The message in ``frame``, or why there is none; never raises."""
    can_id, data, flags = frame
    codec = _CODECS_BY_ID.get(can_id)
    if codec is None or flags != codec.flags or len(data) != codec.length:
        return misfit_of(frame)
    unpacked = codec.unpack(data)
    if not isinstance(unpacked, tuple):
        return cause_of(unpacked, can_id, data)
    return new_record(Decoded, unpacked)


def misfit_of(frame: Frame) -> Rejection:
    """Return why the identifier, length and flags of ``frame`` are those of no message."""
    can_id, data, flags = frame
    if flags & ERROR:  # its identifier is an error class and may equal one of ours
        return Rejection.WRONG_FORMAT
    codec = _CODECS_BY_ID.get(can_id)
    if codec is None:
        return Rejection.UNKNOWN_ID
    if flags & (EXTENDED | REMOTE):
        return Rejection.WRONG_FORMAT
    return Rejection.WRONG_LENGTH if len(data) != codec.length else Rejection.WRONG_FORMAT


def cause_of(unpacked: Rejection, can_id: int, data: bytes) -> Rejection:
    """Return why a payload was refused; tells one of another message or revision from damage."""
    if unpacked is Rejection.BAD_CRC:
        if is_masqueraded(data, _ID_MARKS):
            return Rejection.MASQUERADED
        if is_masqueraded(data, _REVISION_MARKS[can_id]):
            return Rejection.OTHER_REVISION
    return unpacked


class Sender:
    """Makes the frames of one type of message; ``counter`` is that of the next one."""

    def __init__(self, message_type: type[Message]) -> None:
        codec: MessageCodec[Any] = CODECS[message_type]
        self._can_id, self._pack, self._flags = codec.can_id, codec.pack, codec.flags
        self.counter = 0

    def frame(self, message: tuple[Any, ...]) -> Frame:
        """Return the next frame of a message; raises EncodeError as ``encode`` does.

        The message's values alone, in their order, save the time of making it.
        """
        counter, pack = self.counter, self._pack
        self.counter = (counter + 1) % COUNTERS
        return new_record(Frame, (self._can_id, pack(message, counter), self._flags))

    def not_available(self, message: Message) -> Frame:
        """Return the next frame, as ``encode_not_available`` does."""
        counter = self.counter
        self.counter = (counter + 1) % COUNTERS
        return encode_not_available(message, counter)
