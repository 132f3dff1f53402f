"""The layout of a message's payload as the DBC defines it, and each signal as numbers to pack.

``dbc.contract.generated_layout`` has the records of all messages, so that a node needs no DBC
reader.

    raw   = round(value / resolution)       nearest, halves to even
    value = raw * resolution                both as cantools computes them

A NamedTuple's field is matched to its signal by name and unit: ``speed_m_s`` is SPEED in m/s. A
field whose unit differs from the DBC's therefore has no signal. Where a signal's name would not be
unique in the DBC, it begins with the name of its message, which the field omits.
"""

from enum import IntEnum
from operator import index
from typing import Any, NamedTuple


class SignalLayout(NamedTuple):
    """One signal: a little-endian integer, and value = raw * scale.

    ``name``              in the DBC
    ``field``             its name in Python: without its message's name, with its unit
    ``start``             position of its lowest bit, counted from the first bit of the payload
    ``length``            [bits]
    ``minimum, maximum``  range of its values, both included, in its unit
    ``unit``              empty if it has none
    ``not_available``     raw outside that range that means "no value now"; None if there is none
    """

    name: str
    field: str
    start: int
    length: int
    is_signed: bool
    scale: float
    minimum: float
    maximum: float
    unit: str = ""
    not_available: int | None = None


class MessageLayout(NamedTuple):
    """One message.

    ``sender``         the node that alone sends it, as named in the DBC
    ``length``         of its payload [bytes]
    ``cycle_time_ms``  0 if it is not sent cyclically
    ``active_cycle_time_ms``  while it is sent, the shortest; 0 for one that a tool sends
    ``data_id``        of E2E profile 5; None if the message is not protected
    ``signals``        in the order of their bits, without CRC and counter of the protection
    """

    name: str
    sender: str
    can_id: int
    length: int
    cycle_time_ms: int
    active_cycle_time_ms: int
    data_id: int | None
    signals: tuple[SignalLayout, ...]


NOT_AVAILABLE_NAME = "NOT_AVAILABLE"
"""The entry in a signal's value table for "the sender has no value now"."""


class SignalRange(NamedTuple):
    """The values a signal carries, both ends included, in the unit of its field."""

    minimum: float
    maximum: float


class PackedSignal(NamedTuple):
    """Place of a signal in the payload, and meaning of its raw integers.

    ``kind``           type of its values: float, by the resolution; int; or an IntEnum
    ``resolution``     value of one raw, the integer 1 for integers
    ``shift``          position of its lowest bit, counted from the first bit of the payload
    ``mask``           a one for each of its bits
    ``sign``           weight of the sign bit, 0 for an unsigned signal
    ``raw_minimum``, ``raw_maximum``  the DBC's range
    ``not_available``  raw outside that range that means "no value now"
    ``text``           name and allowed values, for an error message
    """

    kind: type
    resolution: float
    shift: int
    mask: int
    sign: int
    raw_minimum: int
    raw_maximum: int
    not_available: int | None
    text: str

    def to_raw(self, value: Any) -> int:
        """Return the raw of a value, in its range or not.

        Raises TypeError, ValueError or OverflowError for a value of the wrong kind.
        """
        if self.kind is float:
            return round(float(value / self.resolution))
        # Members of two IntEnums may be equal as numbers, so the class has to be checked.
        if issubclass(self.kind, IntEnum) and type(value) is not self.kind:
            raise TypeError(value)
        return index(value)


def packed_signal(signal: SignalLayout, kind: type) -> PackedSignal:
    """The numbers for ``signal``, standing for a field of type ``kind`` (float, int or an IntEnum).

    Raises ValueError for an integer with a resolution other than 1, and for an enumeration without
    an end of its signal's range.
    """
    if kind is not float and signal.scale != 1:
        raise ValueError(f"{signal.name}: an integer needs the resolution 1")
    minimum, maximum = signal.minimum, signal.maximum
    allowed = f"{minimum} to {maximum} {signal.unit}".rstrip()
    resolution = signal.scale
    if kind is float:
        resolution = float(signal.scale)
    elif issubclass(kind, IntEnum):
        if not min(kind) <= minimum <= maximum <= max(kind):
            raise ValueError(f"{signal.name}: {allowed} are more than {kind.__name__} has")
        sent = [member for member in kind if minimum <= member <= maximum]
        allowed = "one of " + ", ".join(f"{kind.__name__}.{member.name}" for member in sent)
    else:
        resolution = 1
        allowed += ", an integer"
    return PackedSignal(
        kind=kind,
        resolution=resolution,
        shift=signal.start,
        mask=(1 << signal.length) - 1,
        sign=1 << signal.length - 1 if signal.is_signed else 0,
        raw_minimum=round(minimum / signal.scale),
        raw_maximum=round(maximum / signal.scale),
        not_available=signal.not_available,
        text=f"{signal.name}: allowed is {allowed}",
    )
