"""Fast constructors of NamedTuples, for records of every frame or tick.

A NamedTuple's own constructor is a Python call, 0.4 % of a tick; by field names it takes twice
as long as ``fast_constructor``. The records made here in every frame and tick are together 3 %
(instructions by callgrind). mypy does not check the types in ``new_record``, so other records are
made plainly.
"""

from typing import Any, TypeVar, cast

_Record = TypeVar("_Record", bound=tuple[Any, ...])

new_record = tuple.__new__
"""``new_record(NamedTupleType, (first, second, ...))``"""


def fast_constructor(kind: type[_Record]) -> type[_Record]:
    """Return what makes records of a NamedTuple by field names, as its class does."""
    return _by_fields(kind, "new(kind, ({fields},))")


def field_values(kind: type[_Record]) -> type[_Record]:
    """Return what makes plain tuples of a NamedTuple's values, by field names.

    A ``Sender`` takes them; the record itself would take as long again.
    """
    return _by_fields(kind, "({fields},)")


def _by_fields(kind: type[_Record], made: str) -> type[_Record]:
    fields = ", ".join(getattr(kind, "_fields"))  # noqa: B009 - a tuple has none
    source = f"lambda {fields}: {made.format(fields=fields)}"
    make = eval(source, {"new": new_record, "kind": kind})  # noqa: S307
    make.__defaults__ = kind.__new__.__defaults__
    return cast(type[_Record], make)
