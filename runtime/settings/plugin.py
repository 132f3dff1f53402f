"""Parts from other packages, named ``package.module:ATTRIBUTE``.

Settings name such a part and may have a table for it, whose model is the part's own.
"""

import json
import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any, Protocol, TypeVar, cast, runtime_checkable

from pydantic import (
    AfterValidator,
    Field,
    PlainValidator,
    SerializeAsAny,
    ValidationError,
    ValidationInfo,
    WithJsonSchema,
)

from .mistakes import explain, schema_of
from .settings import Settings, SettingsError

PLACE = "package.module:ATTRIBUTE"
PluginTable = SerializeAsAny[Settings] | None
"""A part's own table: of its own model, or None for a part without one."""
TABLE_SCHEMA = WithJsonSchema({"type": "object"})
PLUGIN_TABLE: Any = Field(default_factory=dict, validate_default=True)
"""Default of such a table, from the part's model."""


@runtime_checkable
class Part(Protocol):
    """A part that may have a table of settings."""

    @property
    def settings(self) -> type[Settings] | None:
        """Model of the part's own table; None: it has none."""


class PartError(SettingsError):
    """A part has failed or has returned an invalid value; the text is one line."""


P = TypeVar("P", bound=Part)
R = TypeVar("R")


def find_part(place: str, kind: type[P], noun: str) -> P:
    """Return the part at a place; raises ValueError in one line.

    ``noun``  the kind of part, such as "vehicle model"
    """
    module_name, colon, attribute = place.partition(":")
    if not colon:
        raise ValueError(f"there is no {noun} {place}; one of your own is named {PLACE}")
    try:
        part: Any = import_module(module_name)
    except (Exception, SystemExit) as error:
        text = f"the module {module_name} cannot be imported: {cause(error)}"
        if isinstance(error, ModuleNotFoundError) and error.name == module_name:
            text += "; name its folder in PYTHONPATH"
        raise ValueError(text) from error
    for name in attribute.split("."):
        try:
            part = getattr(part, name)
        except AttributeError as error:
            raise ValueError(f"the module {module_name} has no {attribute}") from error
    if not isinstance(part, kind):
        raise ValueError(
            f"is no {noun} but of type {type(part).__name__}: it has to be a"
            f" steer_by_wire.{kind.__name__}"
        )
    return part


def place_of(part: Part) -> str:
    """Return where a part, a NamedTuple of functions, is found by its name.

    In a notebook that is ``__main__:ATTRIBUTE``. Raises ValueError for a part without a name.
    """
    homes = [it.__module__ for it in cast(tuple[Any, ...], part) if callable(it)]
    for module in dict.fromkeys((*homes, *sys.modules)):
        for attribute, value in vars(sys.modules[module]).copy().items():
            if value is part:
                return f"{module}:{attribute}"
    raise ValueError(
        f"a {type(part).__name__} has no name at the top of a module, by which a run could record"
        " it: assign it to one"
    )


def by_place(value: Any) -> Any:
    """Return a value of settings, or a mapping of them, with parts replaced by their places."""
    if isinstance(value, Mapping):
        return {key: by_place(inner) for key, inner in value.items()}
    return place_of(value) if isinstance(value, Part) else value


def plugin_place(find: Callable[[str], Part]) -> AfterValidator:
    """Return the validator of a key that names a part.

    ``find``  returns the part at a place; raises ValueError
    """

    def validate(place: str) -> str:
        find(place)
        return place

    return AfterValidator(validate)


def plugin_table(
    find: Callable[[str], Part],
    key: str = "model",
    is_own: Callable[[str], bool] = lambda place: ":" in place,
) -> PlainValidator:
    """Return the validator of a part's own table, which follows the key that names the part.

    ``find``    returns the part at a place
    ``is_own``  whether a name is that of a part from another package
    """

    def validate(value: Any, info: ValidationInfo) -> Settings | None:
        place = info.data.get(key)
        is_named = isinstance(place, str) and is_own(place)
        kind = find(str(place)).settings if is_named else None
        if kind is None:
            if value and key in info.data:
                raise ValueError(f"{key} = {place} has no table of its own")
            return None
        if isinstance(value, kind):
            return value
        try:
            return kind.model_validate_json(json.dumps(value, default=str), strict=True)
        except ValidationError as error:
            mistakes = explain(error, schema_of(kind), value, {(): ""})
            # For an omitted table the message does not name it.
            prefix = "" if value else f"{info.field_name}."
            lines = [f"{prefix}{line.removeprefix(': ')}" for line in mistakes]
            raise ValueError("; ".join(lines)) from error

    return PlainValidator(validate)


def call_part(what: str, function: Callable[..., R], *arguments: object) -> R:
    """Return the result of a part's function; its exceptions become a PartError.

    ``what``  the part, such as "vehicle model package.module:ATTRIBUTE"
    """
    try:
        return function(*arguments)
    except Exception as error:
        raise PartError(f"{what} raises {cause(error)}") from error


def cause(error: BaseException) -> str:
    """Return an exception as one line."""
    return f"{type(error).__name__}: {error}".splitlines()[0]
