"""Messages with the fields that a test is about; the others are 0, or the nearest that is allowed.

So a signal that is added to a message breaks no test.
"""

from enum import IntEnum
from typing import Any, TypeVar, get_type_hints

from steer_by_wire.dbc.messages import limits

M = TypeVar("M", bound=tuple[Any, ...])


def message_with(kind: type[M], **fields: Any) -> M:
    """Return a message with these fields."""
    allowed = limits(kind)  # type: ignore[arg-type]
    values = {name: min(max(0, allowed[name].minimum), allowed[name].maximum) for name in allowed}
    others = {
        name: hint(int(values[name]) if issubclass(hint, (int, IntEnum)) else values[name])
        for name, hint in get_type_hints(kind).items()
    }
    return kind(**{**others, **fields})
