"""Files that settings name, which a run depends on without containing them."""

import hashlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TypeVar

from ...dbc.foreign_messages import file_and_bus
from ...runtime.settings import Settings

FILE_KEYS = ("trace_file", "file", "rest_bus")
"""Settings that name a file, or several."""
PART_KEYS = ("law", "model")
"""Settings that may name a part of another package; the results depend on its module."""
S = TypeVar("S", bound=Settings)


def named_files(tables: Any) -> dict[str, Path]:
    """Return every file, and that of every module of another package, by the name in ``tables``.

    ``tables``  settings as plain values: tables by dotted or by single keys, or a list of such
    """
    return {name: file for name, file in _named(tables, "") if file.is_file()}


def digest(file: Path) -> str:
    """Return the SHA-256 of a file; empty if it cannot be read."""
    with suppress(OSError), file.open("rb") as opened:
        return hashlib.file_digest(opened, "sha256").hexdigest()
    return ""


def digest_lines(settings: Iterable[Settings], others: Iterable[Path]) -> str:
    """Return, as sha256sum prints it, what settings name, and ``others`` as far as they exist."""
    tables = [one.model_dump(mode="json", exclude_none=True) for one in settings]
    files = [*named_files(tables).values(), *filter(Path.is_file, others)]
    return "".join(f"{digest(file)}  {file}\n" for file in {file.absolute(): 0 for file in files})


def with_absolute_names(settings: S) -> S:
    """Return settings whose files are found from every folder."""
    found: dict[str, Any] = {}
    for key, value in settings:
        if isinstance(value, Settings):
            found[key] = with_absolute_names(value)
        elif key in FILE_KEYS and value:
            names = value if isinstance(value, tuple) else (value,)
            absolute = tuple(type(name)(Path(name).absolute()) for name in names)
            found[key] = absolute if isinstance(value, tuple) else absolute[0]
    return settings.model_copy(update=found)


def _named(values: Any, key: str) -> Iterator[tuple[str, Path]]:
    """Yield the names in values under a key, each with its file."""
    if isinstance(values, Mapping):
        for below, value in values.items():
            yield from _named(value, below.split(".")[-1])
    elif isinstance(values, list | tuple):
        for value in values:
            yield from _named(value, key)
    elif isinstance(values, str) and (file := _file_of(key, values)) is not None:
        yield values, file


def _file_of(key: str, value: str) -> Path | None:
    """Return the file that a setting names, itself or by a part of another package."""
    if key in FILE_KEYS:
        return file_and_bus(Path(value))[0] if key == "rest_bus" else Path(value)
    if key not in PART_KEYS or ":" not in value:
        return None
    try:
        found = find_spec(value.partition(":")[0])
    except (ImportError, ValueError):  # reported with the settings that name it
        return None
    return None if found is None or found.origin is None else Path(found.origin)
