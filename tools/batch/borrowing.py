"""Arrays without reference counts, for the inside of a compiled loop.

A NamedTuple of arrays that is handed from function to function has every array's reference count
raised and lowered on the way, atomically; here that costs more than the arithmetic. A borrowed
array points to the same memory and counts nothing, so its owner must outlive it: borrow in the
function that Python calls, which holds the owners as its arguments.
"""

from typing import Any

import numpy as np
from numba import carray, from_dtype, types  # type: ignore[attr-defined]
from numba.extending import intrinsic

from tools.batch.compilation import compiled


def _pointer_to(dtype: Any) -> Any:
    """Return a function for compiled code, from an address to a pointer to numba's ``dtype``."""

    @intrinsic
    def pointer(_typing: Any, address: Any) -> Any:
        kind = types.CPointer(dtype)  # type: ignore[no-untyped-call]

        def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
            return builder.inttoptr(arguments[0], context.get_value_type(kind))

        return kind(address), generate

    return pointer


_float_pointer = _pointer_to(types.float64)
_int_pointer = _pointer_to(types.int64)


@compiled
def borrowed_floats(array: Any) -> Any:
    """Return the same float64 memory, uncounted. Raises ValueError unless C-contiguous."""
    if not array.flags.c_contiguous:
        raise ValueError("only C-contiguous arrays can be borrowed")
    return carray(_float_pointer(array.ctypes.data), array.shape)


@compiled
def borrowed_ints(array: Any) -> Any:
    """Return the same int64 memory, uncounted. Raises ValueError unless C-contiguous."""
    if not array.flags.c_contiguous:
        raise ValueError("only C-contiguous arrays can be borrowed")
    return carray(_int_pointer(array.ctypes.data), array.shape)


def borrowed_as(dtype: np.dtype[Any]) -> Any:
    """Return a compiled function that borrows arrays of a structured type."""
    pointer = _pointer_to(from_dtype(dtype))

    @compiled
    def borrowed_structures(array: Any) -> Any:
        """Return the same memory, uncounted. Raises ValueError unless C-contiguous."""
        if not array.flags.c_contiguous:
            raise ValueError("only C-contiguous arrays can be borrowed")
        return carray(pointer(array.ctypes.data), array.shape)

    return borrowed_structures
