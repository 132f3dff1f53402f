"""The layout of a message's payload as defined by the DBC, as plain records.

``dbc.contract.generated_layout`` has the records of all messages, so that a node needs no DBC
reader.
"""

from typing import NamedTuple


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

    ``length``         of its payload [bytes]
    ``cycle_time_ms``  0 if it is not sent cyclically
    ``data_id``        of E2E profile 5; None if the message is not protected
    ``signals``        in the order of their bits, without CRC and counter of the protection
    """

    name: str
    can_id: int
    length: int
    cycle_time_ms: int
    data_id: int | None
    signals: tuple[SignalLayout, ...]
