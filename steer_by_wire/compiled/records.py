"""``new_record`` in compiled code: a tuple becomes a NamedTuple without any work.

``runtime.record.new_record`` is ``tuple.__new__``, which numba does not know.
"""

from collections.abc import Callable
from functools import cache
from typing import Any

from numba import types
from numba.extending import lower_builtin, type_callable

from ..runtime.record import new_record


@cache
def register_records() -> None:
    """Let compiled functions call ``new_record``."""
    type_callable(new_record)(_typing)
    lower_builtin(new_record, types.NamedTupleClass, types.BaseTuple)(_same)


def _typing(_context: Any) -> Callable[[Any, Any], Any]:
    def type_of_call(kind: Any, fields: Any) -> Any:
        if isinstance(kind, types.NamedTupleClass) and isinstance(fields, types.BaseTuple):
            plain: Any = [types.unliteral(field) for field in fields]
            return types.BaseTuple.from_types(plain, kind.instance_class)
        return None

    return type_of_call


def _same(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    """Return the tuple itself: both have the same layout."""
    fields = types.BaseTuple.from_types(list(signature.return_type))
    return context.cast(builder, arguments[1], signature.args[1], fields)
