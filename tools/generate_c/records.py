"""C structs of the records that step functions take and return.

float, bool, int                   double, bool, int64_t
float | None, int | None           double, int64_t; None is NAN, INT64_MIN
an IntEnum                         int64_t, and an enum with its members
NamedTuple                         a struct with its fields. A field with a default that no step
                                   reads is left out
X = tuple[...] of a module         a struct x. Its fields are named as the first step that takes
                                   one apart into plain names calls them; else first, second ...
tuple[...] that a step returns     a struct named after the step, with first, second ...
"""

import re
from collections.abc import Iterator, Mapping
from enum import IntEnum
from types import GenericAlias
from typing import Any, NamedTuple, get_args, get_origin, get_type_hints

_ORDINALS = ("first", "second", "third", "fourth", "fifth", "sixth")
_NUMBERS: Mapping[object, str] = {
    float: "double", bool: "bool", int: "int64_t", float | None: "double", int | None: "int64_t",
}  # fmt: skip


class UntranslatableError(ValueError):
    """What the subset of Python that becomes C does not have."""


class Record(NamedTuple):
    """A struct: its name without ``struct``, and name and kind of each field."""

    name: str
    fields: tuple[tuple[str, "Kind"], ...]


Kind = str | Record
"""``double``, ``bool``, ``int64_t`` or a struct."""


def snake_case(name: str) -> str:
    """Return a C name for a Python class or alias."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[a-z])(?=[0-9])", "_", name).lower()


def member_name(member: IntEnum) -> str:
    """Return the name of an enum's member in C."""
    return f"{snake_case(type(member).__name__)}_{member.name}".upper()


def enumeration(kind: type[IntEnum]) -> str:
    """Return an enum's definition."""
    members = "\n".join(f"    {member_name(it)} = {it.value}," for it in kind)
    return f"enum {{\n{members}\n}};\n"


def parts_of(kind: Kind) -> set[Record]:
    """Return a record and all records in it; none for a number."""
    return (
        set() if isinstance(kind, str) else {kind}.union(*(parts_of(it) for _, it in kind.fields))
    )


def struct(record: Record) -> str:
    """Return a record's definition."""
    fields = "\n".join(f"    {declared(kind)} {name};" for name, kind in record.fields)
    return f"struct {record.name} {{\n{fields}\n}};\n"


def declared(kind: Kind) -> str:
    """Return a kind as a declaration writes it."""
    return kind if isinstance(kind, str) else f"struct {kind.name}"


def names_of_tuples(modules: Iterator[Mapping[str, Any]]) -> Mapping[object, str]:
    """Return the aliases of tuples in the globals of modules, each by its type."""
    aliases: dict[object, str] = {}
    for module in modules:
        for name, value in module.items():
            if isinstance(value, GenericAlias) and get_origin(value) is tuple:
                aliases.setdefault(value, name)
    return aliases


class Records:
    """Finds the struct of a type.

    ``aliases``     names of tuples by their types
    ``taken_apart`` names by type under which steps take tuples apart
    ``read``        names of all fields that steps read

    ``made``        every struct so far, the parts of one before itself
    ``enums``       every IntEnum so far
    """

    def __init__(
        self,
        aliases: Mapping[object, str],
        taken_apart: Mapping[object, tuple[str, ...]],
        read: frozenset[str],
    ) -> None:
        self._aliases, self._taken_apart, self._read = aliases, taken_apart, read
        self._by_type: dict[object, Record] = {}
        self.enums: list[type[IntEnum]] = []

    @property
    def made(self) -> tuple[Record, ...]:
        """All structs found so far, in the order in which C needs them."""
        return tuple(self._by_type.values())

    def kind_of(self, hint: object, name: str = "") -> Kind:
        """Return the kind of a type; ``name`` for a tuple without one.

        Raises UntranslatableError.
        """
        if hint in _NUMBERS:
            return _NUMBERS[hint]
        if isinstance(hint, type) and issubclass(hint, IntEnum):
            if hint not in self.enums:
                self.enums.append(hint)
            return "int64_t"
        has_own_name = hint in self._aliases or isinstance(hint, type)
        key = hint if has_own_name else (hint, name)
        if key not in self._by_type:
            self._by_type[key] = self._record(hint, name)
        return self._by_type[key]

    def _record(self, hint: object, name: str) -> Record:
        if isinstance(hint, type) and issubclass(hint, tuple) and hasattr(hint, "_fields"):
            left_out = {*getattr(hint, "_field_defaults", ())} - self._read
            fields = {key: it for key, it in get_type_hints(hint).items() if key not in left_out}
            name = snake_case(hint.__name__)
        elif get_origin(hint) is tuple:
            name = snake_case(self._aliases[hint]) if hint in self._aliases else name
            kinds = get_args(hint)
            names = self._taken_apart.get(hint, _ORDINALS[: len(kinds)])
            fields = dict(zip(names, kinds, strict=True))
        else:
            raise UntranslatableError(f"the type {hint!r} is neither a number nor a record")
        if not name:
            raise UntranslatableError(f"the type {hint!r} has no name")
        parts = tuple((key, self.kind_of(kind)) for key, kind in fields.items())
        return Record(name, parts)


def hexadecimal(value: float) -> str:
    """Return a number as C99 writes it without loss, and in decimal where that is not obvious."""
    number = float(value)
    return f"{number!r}" if number == round(number) else f"{number.hex()} /* {number!r} */"


def initializer(kind: Kind, value: Any, indent: str = "") -> str:
    """Return a value as C initialises it."""
    if kind == "bool":
        return "true" if value else "false"
    if isinstance(kind, str):
        return f"INT64_C({value})" if kind == "int64_t" else hexadecimal(value)
    within = f"{indent}    "
    parts = zip(kind.fields, value, strict=True)
    lines = [f"{within}.{name} = {initializer(it, part, within)}," for (name, it), part in parts]
    return "\n".join(["{", *lines, f"{indent}}}"])
