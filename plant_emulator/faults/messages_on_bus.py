"""The messages that faults act on, as they are on the bus: ours, or a car's.

A signal fault decodes a message, changes one value and encodes it with the same counter, as a
faulty sender would. A value beyond its signal's range is sent as the end of that range.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from itertools import islice
from typing import TYPE_CHECKING, Any, TypeAlias

from ...dbc import messages
from ...dbc.bus_language import BusLanguage
from ...dbc.codec.layout import MessageLayout
from ...dbc.codec.protection import COUNTERS, protect
from ...dbc.contract.generated_layout import LAYOUTS
from ...dbc.messages import CAN_IDS, DATA_IDS, MESSAGE_TYPES, Decoded, decode, encode, limits
from ...runtime.frame import Frame
from .settings import ALL, MESSAGES_OF, NAMES, OUR_NAMES, FaultSettings, fields_of

if TYPE_CHECKING:
    from .messages_of_car import MessagesOfCar

Change = Callable[[str, float], float]
"""``change(name, value)`` returns the new value of a field."""


MessagesOnBus: TypeAlias = "OurMessages | MessagesOfCar"
"""What faults have to know of the messages on a bus."""

_DOWN, _UP = (MESSAGES_OF[direction] for direction in MESSAGES_OF)
_MOVED_TO: Mapping[int, int] = {
    **dict.fromkeys(map(CAN_IDS.__getitem__, _DOWN), CAN_IDS[messages.SteeringCommand]),
    **dict.fromkeys(map(CAN_IDS.__getitem__, _UP), CAN_IDS[messages.LateralError]),
    CAN_IDS[messages.SteeringCommand]: CAN_IDS[messages.ControllerStatus],
    CAN_IDS[messages.SteeringPlan]: CAN_IDS[messages.ControllerStatus],
    CAN_IDS[messages.LateralError]: CAN_IDS[messages.SteeringStatus],
}
"""The wrong identifier that replaces that of a message."""


def _raws_outside(layout: MessageLayout) -> Iterator[tuple[int, int, int]]:
    """Yield first bit, length and a raw value outside its range of each signal that has one.

    Enumerations and counts first: outside its range, a measured value may be "not available".
    """
    for signal in sorted(layout.signals, key=lambda signal: signal.scale != 1):
        if signal.is_signed:
            raw = 1 << signal.length - 1
            is_outside = -raw * signal.scale < signal.minimum
        else:
            raw = (1 << signal.length) - 1
            is_outside = raw * signal.scale > signal.maximum
        if is_outside:
            yield signal.start, signal.length, raw


_RAW_OUTSIDE: Mapping[int, tuple[int, int, int]] = {
    layout.can_id: place
    for layout in LAYOUTS
    if layout.data_id is not None
    for place in islice(_raws_outside(layout), 1)
}
_TYPES_BY_ID = {can_id: message_type for message_type, can_id in CAN_IDS.items()}


class OurMessages:
    """Our own; ``MessagesOfCar`` has the same methods."""

    names = OUR_NAMES
    _command_ids = frozenset((CAN_IDS[messages.SteeringCommand], CAN_IDS[messages.SteeringPlan]))

    def ids(self, fault: FaultSettings) -> frozenset[int]:
        """Return the identifiers that a fault acts on."""
        kinds = MESSAGES_OF[fault.direction]
        if fault.message != ALL:
            kinds = (MESSAGE_TYPES[fault.message],)
        return frozenset(CAN_IDS[kind] for kind in kinds)

    def starts(self, frame: Frame, now_ns: int) -> bool:  # noqa: ARG002 a car's depends on time
        """Return whether a frame is a command or a plan."""
        return frame.can_id in self._command_ids

    def moved(self, frame: Frame) -> Frame:
        """Return a frame under the identifier of another message of its sender."""
        return frame._replace(can_id=_MOVED_TO.get(frame.can_id, frame.can_id))

    def outside(self, frame: Frame) -> Frame | None:
        """Return the frame with a raw value outside its signal's range.

        None for an invalid frame, or a message whose signals use all of their bits.
        """
        place = _RAW_OUTSIDE.get(frame.can_id)
        if place is None or not isinstance(decode(frame), Decoded):
            return None
        first, bits, raw = place
        word = int.from_bytes(frame.data, "little") & ~((1 << bits) - 1 << first) | raw << first
        payload = bytearray(word.to_bytes(len(frame.data), "little"))
        protect(payload, DATA_IDS[_TYPES_BY_ID[frame.can_id]])
        return frame._replace(data=bytes(payload))

    def values(self, frame: Frame, signal: str) -> Mapping[str, float]:
        """Return the fields that a signal stands for; none of a frame that is not valid."""
        decoded = decode(frame)
        if not isinstance(decoded, Decoded):
            return {}
        names = fields_of(type(decoded.message), signal)
        return {name: float(getattr(decoded.message, name)) for name in names}

    def with_value(self, frame: Frame, signal: str, change: Change, steps: int = 0) -> Frame | None:
        """Return the frame with a signal changed, its counter advanced by ``steps``.

        None if the frame is not a valid message, or the message does not have the signal.
        """
        decoded = decode(frame)
        if not isinstance(decoded, Decoded):
            return None
        message_type, fields = type(decoded.message), decoded.message._asdict()
        names = fields_of(message_type, signal)
        for name in names:
            value = change(name, float(fields[name]))
            fields[name] = within(value, *limits(message_type)[name])
        if not names:
            return None
        return encode(message_type(**fields), (decoded.counter + steps) % COUNTERS)


def within(value: float, low: float, high: float) -> float:
    """Return the value, or the end of the range that it is beyond; the lower one if it is none."""
    return low if math.isnan(value) else min(max(value, low), high)


OURS = OurMessages()


def messages_in(language: BusLanguage) -> MessagesOnBus:
    """Return the messages on a bus."""
    if language.car is None:
        return OURS
    from .messages_of_car import MessagesOfCar  # needs cantools, which takes a while to import

    return MessagesOfCar(language.car)


def naming(language: BusLanguage) -> Mapping[str, Any]:
    """Return the context in which settings of a plant on this bus are validated."""
    return {NAMES: messages_in(language).names}
