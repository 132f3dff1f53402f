"""Arrays without reference counts, for the inside of a compiled loop.

Passing a NamedTuple of arrays to a function raises and lowers every array's reference count,
atomically, which here costs more than the arithmetic. A borrowed array points to the same memory
and has no count, so its owner must outlive it: borrow in the function that Python calls, which
holds the owners as its arguments.
"""

from typing import Any

from numba import types
from numba.extending import intrinsic


def _uncounted(_typing: Any, kind: Any) -> Any:
    """Type the call and define its code; numba's ``carray`` takes longer to compile."""

    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return without_counts(context, builder, kind, arguments[0])

    return kind(kind), generate


def without_counts(context: Any, builder: Any, kind: Any, value: Any) -> Any:
    """Return code for a value of a kind, with all arrays in it uncounted."""
    if isinstance(kind, types.Array):
        view = context.make_helper(builder, kind, value=value)
        view.meminfo = view.meminfo.type(None)
        view.parent = view.parent.type(None)
        return view._getvalue()
    if isinstance(kind, types.BaseTuple):
        inner: Any = kind
        for place, each in enumerate(inner):
            part = builder.extract_value(value, place)
            part = without_counts(context, builder, each, part)
            value = builder.insert_value(value, part, place)
    return value


borrowed: Any = intrinsic(_uncounted)
"""For compiled code: returns an array, or a record with all its arrays and records of arrays, in
the same memory but without reference counts; anything else unchanged."""
