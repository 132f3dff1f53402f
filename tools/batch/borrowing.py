"""Arrays without reference counts, for the inside of a compiled loop.

A NamedTuple of arrays that is handed from function to function has every array's reference count
raised and lowered on the way, atomically; here that costs more than the arithmetic. A borrowed
array points to the same memory and counts nothing, so its owner must outlive it: borrow in the
function that Python calls, which holds the owners as its arguments.
"""

from typing import Any

from numba import types
from numba.extending import intrinsic


def _uncounted(_typing: Any, array: Any) -> Any:
    """Type the call, and say how it is compiled; numba's ``carray`` takes longer to compile."""
    if not isinstance(array, types.Array):
        return None

    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        view = context.make_helper(builder, array, value=arguments[0])
        view.meminfo = view.meminfo.type(None)
        view.parent = view.parent.type(None)
        return view._getvalue()

    return array(array), generate


borrowed: Any = intrinsic(_uncounted)
"""For compiled code: returns an array's own memory without who counts its references."""
