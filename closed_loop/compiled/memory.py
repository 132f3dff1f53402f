"""Records in memory whose address is known, and functions called by address.

The loop is compiled without knowing the law: the law's params and state have the law's own types,
but their addresses are plain numbers, and so are those of the law's functions.

The loop is compiled without reference counts: raising and lowering that of every array in a record
that is passed on would cost more than the arithmetic. So no compiled function makes an array, and
its caller in Python holds its arrays until it ends.
"""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numba
import numpy as np
from numba.core import cgutils, errors
from numba.extending import intrinsic, lower_builtin, type_callable
from numba.np import arrayobj
from numpy.typing import NDArray

from ...controller.prediction.vehicle_kalman_filter import Correction, VehicleGains

_types: Any = numba.types
_cgutils: Any = cgutils
_arrays: Any = arrayobj
_type_callable: Any = type_callable
_lower_builtin: Any = lower_builtin
"""Untyped, as numba has no types for them."""

_FLOATS = _types.Array(_types.float64, 1, "C")
_ROWS = (VehicleGains, Correction)
KEPT_BYTES = 2048
"""Size of the memory that ``at`` may be given."""


class Memory(NamedTuple):
    """Memory and its address, which is valid as long as the memory is named.

    ``tables``  that a record in it has the addresses of
    """

    array: NDArray[Any]
    address: int
    tables: Sequence[NDArray[Any]] = ()


def layout_of(value: Any) -> np.dtype[Any]:
    """Return how compiled code lays out nested tuples of numbers. Raises TypingError."""
    if isinstance(value, tuple):
        fields = [(f"f{place}", layout_of(each)) for place, each in enumerate(value)]
        return np.dtype(fields, align=True)
    if not isinstance(value, int | float | np.generic):
        raise errors.TypingError(f"{value!r} among its params or in its state is not a number")
    return np.asarray(value).dtype


def memory_of(layout: np.dtype[Any]) -> Memory:
    """Return memory with room for what has this layout."""
    array = np.empty((), layout)
    return Memory(array, array.ctypes.data)


def with_tables(value: Any) -> tuple[Any, list[NDArray[Any]]]:
    """Return nested tuples with the address of each table of gains in its place, and the tables."""
    if type(value) is list and type(value[0]) is tuple:  # rows of numbers
        numbers = np.array(value, np.float64)
        return numbers.ctypes.data, [numbers]
    is_table = type(value) in (list, tuple) and value and isinstance(value[0], _ROWS)
    if isinstance(value, Correction) or not (is_table or isinstance(value, tuple)):
        return value, []
    parts = {id(each): each for each in value}  # most rows of a table are the same one
    made = {key: with_tables(each) for key, each in parts.items()}
    fields = [made[id(each)][0] for each in value]
    tables = [table for _, inner in made.values() for table in inner]
    if not is_table:
        return _alike(fields, value), tables
    table = np.array(fields, layout_of(fields[0]))
    return table.ctypes.data, [table, *tables]


def unpacked(values: Any, like: Any) -> Any:
    """Return nested tuples in the types of another record of their kind."""
    if not isinstance(like, tuple):
        return values
    return _alike(map(unpacked, values, like), like)


def _alike(fields: Iterable[Any], like: Any) -> Any:
    """Return a tuple of the type of another one."""
    return type(like)(*fields) if hasattr(like, "_fields") else tuple(fields)


def _at(_typing: Any, address: Any, like: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        pointee = context.get_data_type(signature.return_type.dtype)
        if context.get_abi_sizeof(pointee) > KEPT_BYTES:
            raise errors.LoweringError(f"{like} takes more than {KEPT_BYTES} bytes")
        return builder.inttoptr(arguments[0], pointee.as_pointer())

    return _types.CPointer(_types.unliteral(like))(address, like), generate


def _placed(_typing: Any, value: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind = signature.return_type.dtype
        place = _cgutils.alloca_once(builder, context.get_data_type(kind))
        context.pack_value(builder, kind, arguments[0], place)
        return place

    return _types.CPointer(value)(value), generate


def _read(_typing: Any, pointer: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        return context.unpack_value(builder, signature.return_type, arguments[0])

    return pointer.dtype(pointer), generate


def _write(typing: Any, pointer: Any, value: Any) -> Any:
    is_same = typing.unify_types(pointer.dtype, value) == pointer.dtype

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        if not is_same:
            raise errors.LoweringError(f"{pointer.dtype} at first, but later {value}")
        kind = signature.args[0].dtype
        stored = context.cast(builder, arguments[1], signature.args[1], kind)
        context.pack_value(builder, kind, stored, arguments[0])
        return context.get_dummy_value()

    return _types.void(pointer, value), generate


def _called(_typing: Any, address: Any, like: Any, given: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        convention, result, kinds = context.call_conv, signature.return_type, tuple(given)
        kind = convention.get_function_type(result, kinds)
        function = builder.inttoptr(arguments[0], kind.as_pointer())
        parts = _cgutils.unpack_tuple(builder, arguments[2])
        status, answer = convention.call_function(builder, function, result, kinds, parts)
        with _cgutils.if_unlikely(builder, status.is_error):
            convention.return_status_propagate(builder, status)
        return answer

    return _types.unliteral(like)(address, like, given), generate


def _array(context: Any, builder: Any, size: Any, data: Any) -> Any:
    """Return an array, without a reference count, of numbers that are there already."""
    made = context.make_array(_FLOATS)(context, builder)
    item = context.get_constant(_types.intp, 8)
    _arrays.populate_array(made, builder.bitcast(data, made.data.type), [size], [item], item, None)
    return made._getvalue()


def rows_by_address(row_at: Any, width: int) -> None:
    """Let compiled functions call ``row_at(address, index)``: it returns the floats of a row."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        size = context.get_constant(_types.intp, width)
        index = context.cast(builder, arguments[1], signature.args[1], _types.intp)
        pointer = context.get_value_type(_types.float64).as_pointer()
        first = builder.inttoptr(arguments[0], pointer)
        return _array(context, builder, size, builder.gep(first, [builder.mul(index, size)]))

    _type_callable(row_at)(lambda _context: lambda _address, _index: _FLOATS)
    _lower_builtin(row_at, _types.Integer, _types.Integer)(generate)


def on_stack(make: Any, count: int) -> None:
    """Let compiled functions call ``make``: it returns zeros on the stack of its caller."""

    def generate(context: Any, builder: Any, _signature: Any, _arguments: Any) -> Any:
        kind = _cgutils.ir.ArrayType(context.get_value_type(_types.float64), count)
        place = _cgutils.alloca_once(builder, kind)
        builder.store(_cgutils.ir.Constant(kind, None), place)  # at every call: loops call again
        return _array(context, builder, context.get_constant(_types.intp, count), place)

    _type_callable(make)(lambda _context: lambda: _FLOATS)
    _lower_builtin(make)(generate)


at: Any = intrinsic(_at)
"""(address, like): for compiled code: returns a pointer to a record of the same type."""
placed: Any = intrinsic(_placed)
"""(value): returns a pointer to a copy, which lasts as long as the function runs."""
read: Any = intrinsic(_read)
"""(pointer): returns the record there."""
write: Any = intrinsic(_write)
"""(pointer, value): writes a record, of the type that the pointer is for."""
called: Any = intrinsic(_called)
"""(address, like, arguments): calls a compiled function that takes these arguments and returns
something of the type of ``like``; passes its exceptions on."""
