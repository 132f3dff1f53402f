"""The DBC as cantools reads it, for the generator, tools and tests.

A node uses ``dbc.contract.generated_layout`` instead, because cantools imports python-can and a
command line, and takes longer to import than all the rest of a node.
"""

import re
from pathlib import Path

import cantools.database
from cantools.database.can import Database, Message, Signal

from ...runtime.exit_status import one_line
from ..codec.codec import FILE, ContractError
from ..codec.layout import NOT_AVAILABLE_NAME, MessageLayout, SignalLayout
from ..codec.protection import header_bits


def load_database() -> Database:
    """Read the DBC of this distribution; raises ContractError."""
    try:
        text = Path(__file__).parents[1].joinpath(FILE).read_text("ascii")
    except (OSError, UnicodeDecodeError) as error:
        raise ContractError(f"{FILE}: {one_line(error)}") from error
    return parse_database(text)


def parse_database(text: str) -> Database:
    """Read a DBC; cantools refuses overlapping signals (strict). Raises ContractError."""
    try:
        database = cantools.database.load_string(text, database_format="dbc", strict=True)
    except Exception as error:  # cantools raises more than its own exceptions for a damaged file
        raise ContractError(f"{FILE}: {one_line(error)}") from error
    if not isinstance(database, Database):
        raise ContractError(f"{FILE}: read as {type(database).__name__}")
    return database


def layouts_of(database: Database) -> tuple[MessageLayout, ...]:
    """Return the layout of each message; raises ContractError for unsupported features."""
    layouts = []
    for message in database.messages:
        try:
            layouts.append(_message_layout(message))
        except (KeyError, ValueError, TypeError) as error:
            raise ContractError(f"{FILE}: {message.name}: {one_line(error)}") from error
    return tuple(layouts)


def field_name(message: Message, signal: Signal) -> str:
    """Name of the Python field for ``signal``, with its unit last: m/s^2 is ``_m_s2``.

    Raises ValueError for a unit that cannot be part of a name.
    """
    words = [signal.name.removeprefix(f"{message.name}_"), *re.split("[ /.]", signal.unit or "")]
    name = "_".join(words).replace("^", "").rstrip("_").lower()
    if not name.isidentifier():
        raise ValueError(f"{signal.name}: its unit {signal.unit!r} cannot be part of a name")
    return name


def _message_layout(message: Message) -> MessageLayout:
    data_id = _data_id(message)
    (sender,) = message.senders
    header = header_bits(message.name) if data_id is not None else {}
    return MessageLayout(
        name=message.name,
        sender=sender,
        can_id=message.frame_id,
        length=message.length,
        cycle_time_ms=message.cycle_time or 0,
        active_cycle_time_ms=message.cycle_time or active_cycle_time_ms(message),
        data_id=data_id,
        signals=tuple(
            _signal_layout(message, signal)
            for signal in message.signals
            if signal.name not in header
        ),
    )


def active_cycle_time_ms(message: Message) -> int:
    """Return how often a message is sent that is not always sent [ms]; 0 where nothing says."""
    attributes = message.dbc.attributes if message.dbc else {}
    active = attributes.get("GenMsgCycleTimeActive")
    return int(active.value) if active else 0


def _signal_layout(message: Message, signal: Signal) -> SignalLayout:
    if signal.byte_order != "little_endian" or signal.offset != 0 or signal.is_float:
        raise ValueError(f"{signal.name}: only little-endian integers without offset are packed")
    if signal.minimum is None or signal.maximum is None:
        raise ValueError(f"{signal.name}: no range")
    names = {str(name): raw for raw, name in (signal.choices or {}).items()}
    return SignalLayout(
        name=signal.name,
        field=field_name(message, signal),
        start=signal.start,
        length=signal.length,
        is_signed=signal.is_signed,
        scale=signal.scale,
        minimum=signal.minimum,
        maximum=signal.maximum,
        unit=signal.unit or "",
        not_available=names.get(NOT_AVAILABLE_NAME),
    )


def _data_id(message: Message) -> int | None:
    attributes = message.dbc.attributes if message.dbc else {}
    header = header_bits(message.name)
    if "E2EDataId" not in attributes:
        if not header.keys().isdisjoint(message.signal_tree):
            raise ValueError("has signals of E2E profile 5 but no attribute E2EDataId")
        return None
    for name, place in header.items():
        signal = message.get_signal_by_name(name)
        if (signal.start, signal.length) != place:
            raise ValueError(f"{name}: profile 5 needs first bit, bits = {place}")
    return int(attributes["E2EDataId"].value)
