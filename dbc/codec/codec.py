"""Codec of one message: packs and unpacks its payload, as the DBC defines it.

``dbc.codec.packing`` generates the functions once, from ``dbc.contract.generated_layout``, because
packing with cantools takes longer than a step of the control law.
"""

from collections.abc import Callable, Iterable, Mapping
from enum import StrEnum
from typing import Any, Generic, TypeVar, get_type_hints

from ...runtime.exit_status import one_line
from ...runtime.frame import BITRATE_SWITCH, CLASSIC_LENGTH_MAX, FD
from .layout import NOT_AVAILABLE_NAME, MessageLayout, SignalRange, packed_signal
from .packing import packing_of
from .protection import COUNTERS, protect

FILE = "steer_by_wire.dbc"
"""The contract, next to the folder of this file."""


class EncodeError(ValueError):
    """A value that its signal cannot carry; the text names message, signal, range and value."""


class ContractError(ImportError):
    """The DBC does not match the messages; the text is one line.

    An ImportError, because without the contract there are no messages to import.
    """


class Rejection(StrEnum):
    """Why a received frame is not a message."""

    UNKNOWN_ID = "unknown_id"
    """No message of ours has this identifier."""
    WRONG_FORMAT = "wrong_format"
    """An extended, remote or error frame, or CAN FD where the message is classic or vice versa."""
    WRONG_LENGTH = "wrong_length"
    BAD_CRC = "bad_crc"
    """Corrupted: the CRC is not that of the content under this identifier."""
    MASQUERADED = "masqueraded"
    """The CRC is that of another message of ours, sent under this identifier."""
    OTHER_REVISION = "other_revision"
    """The CRC is that of another major revision of the DBC."""
    OUT_OF_RANGE = "out_of_range"
    """A signal outside its range or value table."""
    NOT_AVAILABLE = "not_available"
    """The sender has no value for a signal now."""
    OWN_IDENTIFIER = "own_identifier"
    """Under an identifier that only the receiver sends: it has a second sender."""
    SECOND_SENDER = "second_sender"
    """Not followed while there is a second sender, as the settings ask."""
    INTERVENTION = "intervention"
    """Changes latency or disturbance, which the receiver was not started to accept."""


MessageT = TypeVar("MessageT", bound=tuple[Any, ...])


class MessageCodec(Generic[MessageT]):
    """One message of the DBC and its NamedTuple."""

    def __init__(self, message: MessageLayout, message_type: type[MessageT]) -> None:
        """Build the tables.

        Raises KeyError for a field of ``message_type`` that has no signal of its name and unit, and
        ValueError for features of a DBC that this codec does not support.
        """
        self.layout = message
        self.name = message.name
        self.can_id = message.can_id
        self.length = message.length
        self.flags = FD | BITRATE_SWITCH if message.length > CLASSIC_LENGTH_MAX else 0
        self.data_id = message.data_id
        signals = {signal.field: signal for signal in message.signals}
        kinds = get_type_hints(message_type)
        self._signals = {name: packed_signal(signals[name], kind) for name, kind in kinds.items()}
        packing = packing_of(
            message_type,
            self.length,
            self.data_id,
            self._signals,
            self._cannot_send,
            Rejection.BAD_CRC,
            self._refusal,
        )
        self.pack: Callable[[MessageT, int], bytes] = packing.pack
        """Payload of a message with a counter; raises EncodeError."""
        self.unpack: Callable[[bytes], tuple[MessageT, int] | Rejection] = packing.unpack
        """Message and E2E counter (0 where there is none) in a payload of the right length.

        Where several signals are bad, the first one in the order of the fields decides.
        """
        self.source = packing.source
        self.limits = {
            name: SignalRange(signals[name].minimum, signals[name].maximum) for name in kinds
        }
        self.resolutions = {name: float(signals[name].scale) for name in kinds}

    def pack_not_available(self, message: MessageT, counter: int) -> bytes:
        """Like ``pack``, with every signal NOT_AVAILABLE that can be; raises EncodeError."""
        payload = bytearray(self.pack(message, counter))
        mask = bits = 0
        for signal in self._signals.values():
            if signal.not_available is not None:
                mask |= signal.mask << signal.shift
                bits |= (signal.not_available & signal.mask) << signal.shift
        if not mask:
            raise EncodeError(f"{self.name}: none of its signals can be {NOT_AVAILABLE_NAME}")
        word = int.from_bytes(payload, "little") & ~mask | bits
        payload[:] = word.to_bytes(self.length, "little")
        if self.data_id is not None:
            protect(payload, self.data_id)
        return bytes(payload)

    def _cannot_send(self, message: MessageT, counter: int) -> EncodeError:
        for value, signal in zip(message, self._signals.values(), strict=True):
            try:
                is_carried = signal.raw_minimum <= signal.to_raw(value) <= signal.raw_maximum
            except (TypeError, ValueError, OverflowError):  # no number, NaN, infinite
                is_carried = False
            if not is_carried:
                return EncodeError(f"{self.name}.{signal.text}, not {value!r}")
        return EncodeError(
            f"{self.name}.{self.name}_COUNTER: allowed is 0 to {COUNTERS - 1}, not {counter!r}"
        )

    def _refusal(self, *raws: int) -> Rejection:
        """Return why raws are refused, at least one of which is outside its range."""
        for raw, signal in zip(raws, self._signals.values(), strict=True):
            if not signal.raw_minimum <= raw <= signal.raw_maximum:
                break
        return Rejection.NOT_AVAILABLE if raw == signal.not_available else Rejection.OUT_OF_RANGE


def codecs_of(
    layouts: Iterable[MessageLayout], message_types: Iterable[tuple[str, type[MessageT]]]
) -> Mapping[type[MessageT], MessageCodec[MessageT]]:
    """Return the codec of each type, by the name of its message; raises ContractError."""
    by_name = {layout.name: layout for layout in layouts}
    codecs = {}
    for name, message_type in message_types:
        try:
            codecs[message_type] = MessageCodec(by_name[name], message_type)
        except (KeyError, ValueError, TypeError, ArithmeticError) as error:
            raise ContractError(f"{FILE}: {name}: {one_line(error)}") from error
    return codecs
