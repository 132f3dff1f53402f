"""Settings as TOML text, from which they can be loaded again."""

import json
import re
from collections.abc import Collection, Mapping
from typing import Any

from .settings import Settings


def dump_toml(settings: Settings, leave_out: Collection[str] = ()) -> str:
    """Return ``settings`` as the TOML text that ``load_settings`` makes the same settings of.

    ``leave_out``  keys that are not written, because their defaults hold
    """
    tables = settings.model_dump(mode="json", exclude_none=True, exclude=set(leave_out))
    lines = _toml_table(tables, ())
    return "\n".join(lines).lstrip("\n") + "\n"


def _toml_table(table: Mapping[str, Any], path: tuple[str, ...]) -> list[str]:
    lines = [
        f"{toml_key(key)} = {toml_value(value)}"
        for key, value in table.items()
        if not isinstance(value, dict)
    ]
    for key, value in table.items():
        if isinstance(value, dict):
            header = (*path, toml_key(key))
            lines += ["", f"[{'.'.join(header)}]", *_toml_table(value, header)]
    return lines


def toml_key(key: str) -> str:
    """Return a key in TOML, with quotation marks where it needs them."""
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else toml_value(key)


def toml_value(value: Any) -> str:
    """Return a value in TOML; floats with all their digits, tables inside lists inline."""
    match value:
        case str():
            # A JSON string is a TOML string, except that TOML escapes DEL too.
            return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
        case bool():
            return "true" if value else "false"
        case list():
            return f"[{', '.join(map(toml_value, value))}]"
        case dict():
            pairs = (f"{toml_key(key)} = {toml_value(item)}" for key, item in value.items())
            return f"{{{', '.join(pairs)}}}"
        case _:
            return repr(value)
