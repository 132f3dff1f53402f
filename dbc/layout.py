"""What the DBC says of a message's payload, as plain records.

``dbc.generated_layout`` has them of every message, so that a node needs no reader of DBC files.
"""

from typing import NamedTuple


class SignalLayout(NamedTuple):
    """One signal: a little-endian integer, and value = raw * scale.

    ``name``              in the DBC
    ``field``             that stands for it in Python: without its message's name, with its unit
    ``start``             position of its lowest bit, counted from the first bit of the payload
    ``length``            [bits]
    ``minimum, maximum``  of its values, both included, in its unit
    ``unit``              empty if it has none
    ``not_available``     the raw, outside that range, that means "no value now"; None: no raw does
    """

    name: str
    field: str
    start: int
    length: int
    is_signed: bool
    scale: float
    minimum: float
    maximum: float
    unit: str
    not_available: int | None


class MessageLayout(NamedTuple):
    """One message.

    ``length``         of its payload [bytes]
    ``cycle_time_ms``  0 if it is not sent cyclically
    ``data_id``        of E2E profile 5, None: it is not protected
    ``signals``        in the order of their bits, without CRC and counter of the protection
    """

    name: str
    can_id: int
    length: int
    cycle_time_ms: int
    data_id: int | None
    signals: tuple[SignalLayout, ...]
