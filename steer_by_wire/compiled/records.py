"""``new_record`` in compiled code: a tuple becomes a NamedTuple without any work.

``runtime.record.new_record`` is ``tuple.__new__``, which numba does not know.
"""

from collections.abc import Callable
from functools import cache
from typing import Any

import numba
from numba.extending import lower_builtin, type_callable

from ..runtime.record import new_record

_types: Any = numba.types
_type_callable: Any = type_callable
_lower_builtin: Any = lower_builtin
"""Untyped, as numba has no types for them."""


@cache
def register_records() -> None:
    """Let compiled functions call ``new_record``."""
    _type_callable(new_record)(_typing)
    _lower_builtin(new_record, _types.NamedTupleClass, _types.BaseTuple)(_same)


def _typing(_context: Any) -> Callable[[Any, Any], Any]:
    def type_of_call(kind: Any, fields: Any) -> Any:
        if isinstance(kind, _types.NamedTupleClass) and isinstance(fields, _types.BaseTuple):
            plain = [_types.unliteral(field) for field in fields]
            return _types.BaseTuple.from_types(plain, kind.instance_class)
        return None

    return type_of_call


def _same(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    """Return the tuple itself: both have the same layout."""
    fields = _types.BaseTuple.from_types(list(signature.return_type))
    return context.cast(builder, arguments[1], signature.args[1], fields)
