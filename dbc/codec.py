"""Packs and unpacks the payload of one message, as the DBC defines it.

The tables of shifts and masks are built once from ``dbc.generated_layout``, because packing with
cantools takes longer than a step of the control law.
"""

from collections.abc import Iterable, Mapping
from enum import StrEnum
from typing import Any, Generic, TypeVar, get_type_hints

from ..runtime.error_text import one_line
from .layout import MessageLayout
from .protection import COUNTERS, is_intact, protect
from .signals import (
    NOT_AVAILABLE_NAME,
    packed_signal,
    signal_range,
)

FILE = "steer_by_wire.dbc"
"""The contract, beside this file."""


class EncodeError(ValueError):
    """A value that its signal cannot carry; the text names message, signal, range and value."""


class ContractError(ImportError):
    """The DBC is not what the messages need; the text is one line.

    An ImportError, because without the contract there are no messages to import.
    """


class Rejection(StrEnum):
    """Why a received frame is not a message."""

    UNKNOWN_ID = "unknown_id"
    """No message of ours has this identifier."""
    WRONG_FORMAT = "wrong_format"
    """An extended, remote, error or FD frame; all of ours are classic data frames."""
    WRONG_LENGTH = "wrong_length"
    BAD_CRC = "bad_crc"
    """Corrupted: the CRC is not that of the content under this identifier."""
    MASQUERADED = "masqueraded"
    """The CRC is that of another message of ours, sent under this identifier."""
    OUT_OF_RANGE = "out_of_range"
    """A signal outside its range or value table."""
    NOT_AVAILABLE = "not_available"
    """The sender has no value for a signal now."""


MessageT = TypeVar("MessageT", bound=tuple[Any, ...])


class MessageCodec(Generic[MessageT]):
    """One message of the DBC and the NamedTuple that stands for it."""

    def __init__(self, message: MessageLayout, message_type: type[MessageT]) -> None:
        """Build the tables.

        Raises KeyError for a field of ``message_type`` that has no signal of its name and unit, and
        ValueError for what the DBC may ask but this codec does not do.
        """
        self.name = message.name
        self.can_id = message.can_id
        self.length = message.length
        self.cycle_time_ms = message.cycle_time_ms
        self.data_id = message.data_id
        self._message_type = message_type
        signals = {signal.field: signal for signal in message.signals}
        kinds = get_type_hints(message_type)
        self._signals = tuple(packed_signal(signals[name], kind) for name, kind in kinds.items())
        self.limits = {name: signal_range(signals[name]) for name in kinds}
        self.resolutions = {name: float(signals[name].scale) for name in kinds}

    def pack(self, message: MessageT, counter: int) -> bytes:
        """Payload of ``message``; raises EncodeError."""
        return self._seal(self._word(message), counter)

    def pack_not_available(self, message: MessageT, counter: int) -> bytes:
        """Like ``pack``, but every signal that can be NOT_AVAILABLE is; raises EncodeError."""
        word = self._word(message)
        mask = bits = 0
        for signal in self._signals:
            if signal.not_available is not None:
                mask |= signal.mask << signal.shift
                bits |= (signal.not_available & signal.mask) << signal.shift
        if not mask:
            raise EncodeError(f"{self.name}: none of its signals can be {NOT_AVAILABLE_NAME}")
        return self._seal(word & ~mask | bits, counter)

    def unpack(self, payload: bytes) -> tuple[MessageT, int] | Rejection:
        """Message and E2E counter (0 where there is none) in a payload of the right length.

        Where several signals are bad, the first one in the order of the fields decides.
        """
        counter = 0
        if self.data_id is not None:
            if not is_intact(payload, self.data_id):
                return Rejection.BAD_CRC
            counter = payload[2]
        word = int.from_bytes(payload, "little")
        values: list[Any] = []
        for (
            _, from_raw, resolution, shift, mask, sign, minimum, maximum, not_available, _
        ) in self._signals:  # fmt: skip
            raw = ((word >> shift & mask) ^ sign) - sign
            if minimum <= raw <= maximum:
                values.append(raw * resolution if from_raw is None else from_raw(raw))
            elif raw == not_available:
                return Rejection.NOT_AVAILABLE
            else:
                return Rejection.OUT_OF_RANGE
        return self._message_type(*values), counter

    def _word(self, message: MessageT) -> int:
        """All fields in one integer, the first bit of the payload lowest."""
        word = 0
        for value, (to_raw, _, resolution, shift, mask, _, minimum, maximum, _, text) in zip(
            message, self._signals, strict=True
        ):
            try:
                raw = round(value / resolution) if to_raw is None else to_raw(value)
            except (TypeError, ValueError, OverflowError) as error:  # no number, NaN, infinite
                raise EncodeError(f"{self.name}.{text}, not {value!r}") from error
            if not minimum <= raw <= maximum:
                raise EncodeError(f"{self.name}.{text}, not {value!r}")
            word |= (raw & mask) << shift
        return word

    def _seal(self, word: int, counter: int) -> bytes:
        """The payload for ``word``, with counter and CRC if the message is protected."""
        if self.data_id is None:
            return word.to_bytes(self.length, "little")
        if not 0 <= counter < COUNTERS:
            raise EncodeError(
                f"{self.name}.{self.name}_COUNTER: allowed is 0 to 255, not {counter!r}"
            )
        payload = bytearray(word.to_bytes(self.length, "little"))
        payload[2] = counter
        protect(payload, self.data_id)
        return bytes(payload)


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
