"""A message as JSON with its JSON schema, for Foxglove and PlotJuggler.

Both programs read these without plug-ins. An enumeration is its number, to be plotted, and beside
it its name.
"""

from enum import IntEnum
from functools import cache
from typing import Any, get_type_hints

from ...dbc.messages import MESSAGE_TYPES, Message


def json_schema(name: str) -> dict[str, Any]:
    """Return the schema of a message, by its name in the DBC."""
    properties: dict[str, dict[str, str]] = {}
    for field, kind in get_type_hints(MESSAGE_TYPES[name]).items():
        properties[field] = {"type": "number" if kind is float else "integer"}
        if field in _enumerations(name):
            properties[f"{field}_name"] = {"type": "string"}
    return {"title": name, "type": "object", "properties": properties}


def json_content(name: str, message: Message) -> dict[str, Any]:
    """Return a message, ready for JSON."""
    content: dict[str, Any] = message._asdict()
    for field in _enumerations(name):
        content[f"{field}_name"] = content[field].name
    return content


@cache
def _enumerations(name: str) -> tuple[str, ...]:
    """Return the fields that are enumerations."""
    kinds = get_type_hints(MESSAGE_TYPES[name]).items()
    return tuple(
        field for field, kind in kinds if isinstance(kind, type) and issubclass(kind, IntEnum)
    )
