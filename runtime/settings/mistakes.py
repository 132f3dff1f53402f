"""One line about a mistake in a setting: source, dotted key, value, what is allowed.

    plant.toml: vehicle.speed_m_s = -3 should be greater than 0 (allowed: number above 0, up to 60)
    command line: vehicle.sped_m_s is not a known key (did you mean vehicle.speed_m_s?)

The allowed range comes from the model's JSON schema, which has all limits of a field. An error of
pydantic names only the one that was violated.
"""

import difflib
import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

KeyPath = tuple[str | int, ...]
"""Path of a setting: keys of tables and indices of lists, from the top."""
Schema = Mapping[str, Any]

_MISTAKES_MAX = 20
_VALUE_LENGTH_MAX = 60
_LIKENESS_MIN = 0.85
"""Least similarity, 0 to 1, of a key in another table: it must be nearly the one written."""
_MEANT_MAX = 4
"""A key that more tables than this have is no hint."""
_WORDS_OF_TYPES = {
    "array": "list of",
    "boolean": "true or false",
    "integer": "integer",
    "number": "number",
    "object": "table",
    "string": "string",
}
_WORDS_OF_LIMITS = {
    "exclusiveMinimum": "above",
    "minimum": "from",
    "exclusiveMaximum": "below",
    "maximum": "up to",
    "minItems": "at least",
    "maxItems": "at most",
    "minLength": "at least",
    "maxLength": "at most",
    "pattern": "like",
}


@cache
def schema_of(model: type[BaseModel]) -> Schema:
    """Return the JSON schema of a model, which takes long to make."""
    return model.model_json_schema()


def explain(
    error: ValidationError, schema: Schema, data: Mapping[str, Any], sources: Mapping[KeyPath, str]
) -> list[str]:
    """Return one line for each mistake, up to a screenful; unknown keys with one hint share theirs.

    ``data``     what was validated
    ``sources``  source of each key of ``data``; other keys have that of the nearest table above
    """
    told: dict[tuple[str, str], dict[str, None]] = {}
    for mistake in error.errors(include_url=False):
        if mistake["type"] == "extra_forbidden":
            path = _path_in(data, mistake["loc"], mistake["type"])
            place = _source(sources, path), _hint_of(path, schema, data)
            told.setdefault(place, {})[dotted(path)] = None
        elif not _is_consequence(mistake):
            told.setdefault(("", _explain_one(mistake, schema, data, sources)), {})
    mistakes = [
        _unknown(source, [*keys], text) if keys else text for (source, text), keys in told.items()
    ]
    more = len(mistakes) - _MISTAKES_MAX
    if more > 0:
        mistakes[_MISTAKES_MAX:] = [f"and {more} mistakes more"]
    return mistakes


def meant(name: str, known: Iterable[str], prefix: str = "") -> str:
    """Return the question whether the nearest of ``known`` was meant; empty if none is near."""
    nearest = difflib.get_close_matches(name, list(known), n=1)
    return f"did you mean {prefix}{nearest[0]}?" if nearest else ""


def hint(name: str, known: Iterable[str], prefix: str = "") -> str:
    """Return what ``name`` may have meant: the nearest of ``known``, or all."""
    names = list(known)
    return meant(name, names, prefix) or f"known: {', '.join(names) or 'none'}"


def _meant_below(root: Schema, name: str, siblings: Iterable[str]) -> str:
    """Return the keys of other tables that ``name`` may have meant, if nearer than ``siblings``."""

    def likeness(known: str) -> float:
        return difflib.SequenceMatcher(None, name, known).ratio()

    found = dict.fromkeys(_keys_below(root, root, (), ()))
    best = max((likeness(key.rpartition(".")[2]) for key in found), default=0.0)
    if best < _LIKENESS_MIN or best <= max(map(likeness, siblings), default=0.0):
        return ""
    nearest = [key for key in found if likeness(key.rpartition(".")[2]) == best]
    if len(nearest) > _MEANT_MAX:
        return ""
    return f"did you mean {' or '.join(nearest)}?"


def setting_keys(model: type[BaseModel]) -> list[str]:
    """Return the dotted keys of all values that are no tables."""
    root = schema_of(model)
    found = dict.fromkeys([*root["properties"], *_keys_below(root, root, (), ())])
    tables = {key.rpartition(".")[0] for key in found}
    return sorted(key for key in found if key not in tables)


def setting_words(model: type[BaseModel]) -> list[str]:
    """Return ``key=`` for all values that are no tables, and ``key=value`` for each known value."""
    root = schema_of(model)
    words = []
    for key in setting_keys(model):
        values = {
            str(value): None
            for schema in _schemas_at(root, tuple(key.split(".")), {})
            for value in schema.get("enum", [schema["const"]] if "const" in schema else [])
        }
        words += [f"{key}=", *(f"{key}={value}" for value in values)]
    return words


def _keys_below(root: Schema, schema: Schema, path: KeyPath, above: Sequence[str]) -> Iterator[str]:
    """Return the dotted keys of the tables below ``schema``; lists are left out."""
    for alternative in _alternatives(root, schema, None):
        title = str(alternative.get("title", ""))
        if title in above:
            continue
        for key, child in alternative.get("properties", {}).items():
            if path:
                yield dotted((*path, key))
            yield from _keys_below(root, child, (*path, key), (*above, title))


def _is_consequence(mistake: ErrorDetails) -> bool:
    """Whether a list only counts as too short because its elements are mistakes."""
    value, context = mistake["input"], mistake.get("ctx", {})
    is_list = isinstance(value, list) and mistake["type"] == "too_short"
    return is_list and len(value) >= context["min_length"]


def allowed(schema: Schema, path: KeyPath) -> str:
    """Return what the setting at ``path`` may be, in words; empty for anything."""
    return " or ".join(_texts(_schemas_at(schema, path, {})))


def _unknown(source: str, keys: list[str], hinted: str) -> str:
    if len(keys) > _MISTAKES_MAX:
        keys[_MISTAKES_MAX:] = [f"{len(keys) - _MISTAKES_MAX} more"]
    are = "is not a known key" if len(keys) == 1 else "are not known keys"
    return f"{source}: {', '.join(keys)} {are} ({hinted})"


def _hint_of(path: KeyPath, schema: Schema, data: Mapping[str, Any]) -> str:
    """Return which key may be meant by an unknown one."""
    name = str(path[-1])
    tables = _schemas_at(schema, path[:-1], data)
    siblings = {key for table in tables for key in table.get("properties", ())}
    prefix = dotted(path).removesuffix(name)
    return _meant_below(schema, name, siblings) or hint(name, sorted(siblings), prefix)


def _explain_one(
    mistake: ErrorDetails, schema: Schema, data: Mapping[str, Any], sources: Mapping[KeyPath, str]
) -> str:
    context = mistake.get("ctx", {})
    path, value = _path_in(data, mistake["loc"], mistake["type"]), mistake["input"]
    if "discriminator" in context:
        # pydantic reports the table, but the mistake is in the key that selects its kind.
        path, value = (*path, context["discriminator"].strip("'")), context.get("tag")
    key, texts = dotted(path), list(_texts(_schemas_at(schema, path, data)))
    may_be = f" (allowed: {' or '.join(texts)})" if texts else ""
    where = f"{_source(sources, path)}: {key}"
    match mistake["type"]:
        case "missing" | "union_tag_not_found":
            return f"{where} is missing{may_be}"
        case "value_error" if isinstance(value, dict):
            # A whole table: its content would hide the message.
            return f"{where.removesuffix(': ')}: {context['error']}"
        case "value_error":
            return f"{where} = {_shown(value)}: {context['error']}"
        case "union_tag_invalid" | "enum" | "literal_error":
            # pydantic's message would repeat the allowed values.
            question = meant(str(value), ", ".join(texts).split(", "))
            offered = may_be.replace("(", f"({question} ", 1) if question else may_be
            return f"{where} = {_shown(value)} is not a known one{offered}"
        case _ if len(texts) > 1:
            # pydantic reports each member of a union, which what is allowed names.
            return f"{where} = {_shown(value)} cannot be used{may_be}"
        case _:
            what = re.sub(r"^\w+ (?=should)| after validation", "", mistake["msg"])
            return f"{where} = {_shown(value)} {what}{may_be}"


def _path_in(data: Mapping[str, Any], location: KeyPath, kind: str) -> KeyPath:
    """Return pydantic's ``location`` without the members of unions that it tried.

    The key of a missing value is kept.
    """
    path: list[str | int] = []
    here: Any = data
    for index, step in enumerate(location):
        children = _children(here)
        if step in children:
            here = children[step]
        elif kind != "missing" or index < len(location) - 1:
            continue
        path.append(step)
    return tuple(path)


def _children(value: Any) -> Mapping[str | int, Any]:
    if isinstance(value, list):
        return dict(enumerate(value))
    return value if isinstance(value, dict) else {}


def _source(sources: Mapping[KeyPath, str], path: KeyPath) -> str:
    while path not in sources:
        path = path[:-1]
    return sources[path]


def dotted(path: KeyPath) -> str:
    """Return ``path`` as the user writes it: ``table.key[index]``."""
    text = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in path)
    return text.removeprefix(".")


def _shown(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False, default=str)
    return text if len(text) <= _VALUE_LENGTH_MAX else f"{text[:_VALUE_LENGTH_MAX]}..."


def _schemas_at(root: Schema, path: KeyPath, data: Any) -> Sequence[Schema]:
    """Return all schemas that a value at ``path`` may follow; several in a union."""
    found = list(_alternatives(root, root, data))
    for step in path:
        data = _children(data).get(step)
        children = [child for schema in found if (child := _child(schema, step)) is not None]
        found = [schema for child in children for schema in _alternatives(root, child, data)]
    return found


def _child(schema: Schema, step: str | int) -> Schema | None:
    if isinstance(step, str):
        child = schema.get("properties", {}).get(step, schema.get("additionalProperties"))
    else:
        items = schema.get("prefixItems", ())
        child = items[step] if step < len(items) else schema.get("items")
    return child if isinstance(child, dict) else None


def _alternatives(root: Schema, schema: Schema, data: Any) -> Iterator[Schema]:
    """Return ``schema`` with references resolved and unions taken apart.

    Of tables distinguished by a key, only the one that ``data`` names, if it does.
    """
    if "$ref" in schema:
        # Always of the form "#/$defs/Name".
        schema = root["$defs"][schema["$ref"].rpartition("/")[2]]
    if "discriminator" in schema and isinstance(data, dict):
        discriminator = schema["discriminator"]
        tag = data.get(discriminator["propertyName"])
        named = discriminator["mapping"].get(tag) if isinstance(tag, str) else None
        if named is not None:
            schema = {"oneOf": [{"$ref": named}]}
    members = schema.get("anyOf") or schema.get("oneOf")
    if not members:
        yield schema
    for member in members or ():
        yield from _alternatives(root, member, data)


def _texts(schemas: Sequence[Schema]) -> Iterable[str]:
    return dict.fromkeys(filter(None, map(_in_words, schemas)))


def _in_words(schema: Schema) -> str:
    if "const" in schema:
        return str(schema["const"])
    if "enum" in schema:
        return ", ".join(map(str, schema["enum"]))
    limits = ", ".join(
        f"{words} {schema[limit]}" for limit, words in _WORDS_OF_LIMITS.items() if limit in schema
    )
    return f"{_WORDS_OF_TYPES.get(schema.get('type', ''), '')} {limits}".strip().removesuffix(" of")
