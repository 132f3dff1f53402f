"""Settings files: from TOML to frozen pydantic models, with one line for each mistake.

Layers, later ones on top:

1. a preset, TOML shipped inside a package
2. the user's file
3. a table of another file that both programs read (``SharedTable``)
4. ``--set table.key=value``

Tables merge key by key, anything else is replaced as a whole. A table whose ``kind`` changes is
replaced too: the keys below belong to the other kind.

Types are strict, so that ``speed_m_s = "10"`` and ``gain = true`` are refused instead of guessed.
"""

import codecs
import hashlib
import json
import re
import tomllib
from collections.abc import Mapping, Sequence
from importlib import resources
from itertools import takewhile
from os.path import isfile
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, TypeVar

from pydantic import BaseModel, ConfigDict, Discriminator, Tag, ValidationError

from ..exit_status import UserError, printable
from ..input_file import InputError, bounded, read_bytes
from .mistakes import KeyPath, dotted, explain, hint, schema_of

OffWord = Annotated[Literal["off"], Tag("word")]
"""Stands for no limit, in place of a number with ``Tag("number")``: TOML has no null."""
NUMBER_OR_WORD = Discriminator(lambda value: "word" if isinstance(value, str) else "number")
"""Selects one of the two, so that a mistake is reported once."""
DIGESTS = "files.sha256"
"""File in the folder of a run: the digests of the files that its settings name."""
COMMAND_LINE = "command line"
"""The source of ``--set`` and of the options that are short for it."""
_KIND = "kind"
"""Key that distinguishes the members of a union of tables."""
_MARKS = {
    codecs.BOM_UTF8: "utf-8-sig",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}
"""Byte order marks, with which editors save text."""
_DEPTH_MAX = 30
"""Nesting of tables and lists."""
_INTEGER_BITS_MAX = 1024
"""TOML guarantees 64; Python refuses to convert thousands of digits."""


class Settings(BaseModel):
    """Base of every settings table: frozen, unknown keys refused, numbers finite.

    A field that may be None has None as its default, because TOML can only omit the key.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    def __init__(self, /, **values: Any) -> None:
        """Check the values; raises SettingsError."""
        try:
            super().__init__(**values)
        except ValidationError as error:
            source: dict[KeyPath, str] = {(): f"{type(self).__name__}()"}
            mistakes = explain(error, schema_of(type(self)), values, source)
        else:
            return
        raise SettingsError(*mistakes)

    # Tables within tables are checked as if there were no such function: their path is that of all.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]


class SettingsError(UserError, ValueError):
    """Settings that cannot be used; the text has one line for each of ``mistakes``."""

    def __init__(self, *mistakes: str) -> None:
        self.mistakes = tuple(map(printable, mistakes))
        super().__init__("\n".join(self.mistakes))


class Preset(NamedTuple):
    """Settings shipped inside a package: the name the user knows it by, and its TOML text."""

    name: str
    text: str


class SharedTable(NamedTuple):
    """A table of a file that several programs read, under the name each has for it.

    ``source``   the file, for error messages
    ``content``  the table by that name, as settings have it
    """

    source: str
    content: Mapping[str, Any]


S = TypeVar("S", bound=Settings)


def preset_names(package: str) -> list[str]:
    """Return the presets in ``package``, in alphabetical order."""
    files = (Path(entry.name) for entry in resources.files(package).iterdir())
    return sorted(file.stem for file in files if file.suffix == ".toml")


def read_preset(package: str, name: str) -> Preset:
    """Return the preset ``name`` of ``package``; raises SettingsError that lists all presets."""
    names = preset_names(package)
    if name not in names:
        nodes = resources.files(package.partition(".")[0]).iterdir()
        owners = [node.name for node in nodes if isfile(f"{node}/presets/{name}.toml")]
        has_it = f"the {owners[0].replace('_', ' ')} has it; " if owners else ""
        raise SettingsError(
            f"preset {name!r}: there is none of this name ({has_it}{hint(name, names)})"
        )
    file = resources.files(package) / f"{name}.toml"
    return Preset(name, file.read_text(encoding="utf-8"))


def preset_title(package: str, name: str) -> str:
    """Return the first sentence of a preset's comments."""
    lines = takewhile(
        lambda line: line.startswith("#"), read_preset(package, name).text.splitlines()
    )
    return re.split(r"(?<=\.)\s(?=[A-Z])", " ".join(line.strip("# ") for line in lines))[0]


def read_table(
    file: Path, name: str, default: Mapping[str, Any] | None = None
) -> Mapping[str, Any]:
    """Return the table ``name`` of a TOML file, or the default; raises SettingsError."""
    table = _parse(read_text(file), str(file)).get(name, default)
    if not isinstance(table, dict):
        raise SettingsError(f"{file}: has no table [{name}]")
    return table


def load_settings(
    model: type[S],
    preset: Preset | None = None,
    file: Path | None = None,
    overrides: Sequence[str] = (),
    shared: SharedTable | None = None,
    context: Mapping[str, Any] | None = None,
    layers: Sequence[SharedTable] = (),
    node: str = "",
) -> S:
    """Return the checked settings: ``preset``, ``file``, ``shared``, ``overrides`` in layers.

    ``overrides``  each ``table.key=value``; the value is TOML, a bare word counts as a string
    ``context``    what validators of the model find in ``ValidationInfo.context``
    ``layers``     further ones on top of ``shared``
    ``node``       whose the overrides are, where a command line has those of several

    Raises SettingsError.
    """
    merged: dict[str, Any] = {}
    sources: dict[KeyPath, str] = {(): "settings"}
    if preset is not None:
        source = f"preset {preset.name}"
        _merge(merged, _parse(preset.text, source), source, (), sources)
    if file is not None:
        _refuse_changed_files(file.parent / DIGESTS)
        _merge(merged, _parse(read_text(file), str(file)), str(file), (), sources)
    for table in (*filter(None, [shared]), *layers):
        _merge(merged, table.content, table.source, (), sources)
    if overrides:
        source = f"{COMMAND_LINE}, {node}" if node else COMMAND_LINE
        _merge(merged, _parse_overrides(overrides, source), source, (), sources)
    return _checked(model, merged, sources, context)


def with_values(
    settings: S, values: Mapping[str, Any], source: str, context: Mapping[str, Any] | None = None
) -> S:
    """Return ``settings`` with other ``values``, each by its dotted key, as ``table.key``.

    ``values``  any TOML value, NumPy's numbers, paths, or settings
    ``source``  origin of the values, for error messages
    ``context`` as that of ``load_settings``

    Raises SettingsError.
    """
    merged: dict[str, Any] = {}
    sources: dict[KeyPath, str] = {(): "settings"}
    _merge(merged, settings.model_dump(mode="json", exclude_none=True), "settings", (), sources)
    tables: dict[str, Any] = {}
    for key, value in values.items():
        if value is None:
            raise SettingsError(f"{source}: {key} = None: settings have no such value")
        _set(tables, key.split("."), json.loads(json.dumps(value, default=_plain)), source)
    _merge(merged, tables, source, (), sources)
    return _checked(type(settings), merged, sources, context)


def _plain(value: Any) -> Any:
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json", exclude_none=True)
    return value.tolist() if hasattr(value, "tolist") else str(value)  # NumPy's


def _checked(
    model: type[S],
    merged: dict[str, Any],
    sources: dict[KeyPath, str],
    context: Mapping[str, Any] | None,
) -> S:
    try:
        # As JSON: there "strict" still accepts lists for tuples and words for enums.
        return model.model_validate_json(
            json.dumps(merged, default=str), strict=True, context=context
        )
    except ValidationError as error:
        mistakes = explain(error, schema_of(model), merged, sources)
    raise SettingsError(*mistakes)


def encoding_of(raw: bytes) -> str:
    """Return the encoding of a text that begins with ``raw``: UTF-8 but for a byte order mark."""
    return next((name for mark, name in _MARKS.items() if raw.startswith(mark)), "utf-8")


def read_text(file: Path) -> str:
    """Return the text of a file of the user; raises SettingsError."""
    try:
        raw = read_bytes(file)
        return raw.decode(encoding_of(raw)).replace("\r\n", "\n").replace("\r", "\n")
    except OSError as error:
        raise SettingsError(f"{file}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise SettingsError(
            f"{file}: is not {error.encoding.upper()} text (byte {error.start})"
        ) from error
    except InputError as error:
        raise SettingsError(str(error)) from None
    except ValueError as error:  # a NUL in its name
        raise SettingsError(f"{file}: cannot be read: {error}") from error


def _refuse_changed_files(digests: Path) -> None:
    """Refuse settings where a file that they name is another one now; raises SettingsError."""
    if not digests.exists():
        return
    for line in read_text(digests).splitlines():
        digest, _, name = line.partition("  ")
        try:
            content = Path(name).read_bytes()
        except (OSError, ValueError) as error:
            raise SettingsError(f"{digests}: {name or line}: cannot be read: {error}") from error
        if hashlib.sha256(content).hexdigest() != digest:
            raise SettingsError(
                f"{digests}: {name} has changed since the run in this folder: put its content of"
                " that time back, or remove its line here to run with the new one"
            )


def _parse(text: str, source: str) -> dict[str, Any]:
    try:
        with bounded(source):
            tables = tomllib.loads(text)
            _refuse_monsters(tables, source)
    except tomllib.TOMLDecodeError as error:
        # Only Python 3.14 has the line as an attribute; the text has it in all versions.
        found = re.fullmatch(r"(.*) \(at line (\d+), column \d+\)", str(error), re.DOTALL)
        what, place = (found[1], f":{found[2]}") if found else (str(error), "")
        raise SettingsError(f"{source}{place}: is not TOML: {what}") from error
    except RecursionError as error:
        raise SettingsError(f"{source}: is nested more than {_DEPTH_MAX} deep") from error
    except InputError as error:
        raise SettingsError(str(error)) from None
    except SettingsError:
        raise
    except ValueError as error:
        raise SettingsError(f"{source}: is not TOML: {error}") from error
    return tables


def _refuse_monsters(tables: dict[str, Any], source: str) -> None:
    waiting: list[tuple[KeyPath, Any]] = [((), tables)]
    while waiting:
        path, value = waiting.pop()
        if len(path) > _DEPTH_MAX:
            raise SettingsError(f"{source}: {path[0]} is nested more than {_DEPTH_MAX} deep")
        if isinstance(value, int) and value.bit_length() > _INTEGER_BITS_MAX:
            raise SettingsError(f"{source}: {dotted(path)} has more than {_INTEGER_BITS_MAX} bits")
        if isinstance(value, dict):
            waiting += [((*path, key), item) for key, item in value.items()]
        elif isinstance(value, list):
            waiting += [((*path, index), item) for index, item in enumerate(value)]


def _parse_overrides(overrides: Sequence[str], source: str) -> dict[str, Any]:
    tables: dict[str, Any] = {}
    for override in overrides:
        if override != override.encode(errors="ignore").decode():  # its other bytes are surrogates
            raise SettingsError(f"{source}: {override}: is not UTF-8 text")
        place, equals, text = override.partition("=")
        *parents, key = (part.strip() for part in place.split("."))
        if not equals or not text.strip() or not all((*parents, key)):
            raise SettingsError(f"{source}: {override}: is not of the form table.key=value")
        _set(tables, [*parents, key], _parse_value(text, source), f"{source}: {override}")
    _refuse_monsters(tables, source)
    return tables


def _set(tables: dict[str, Any], keys: Sequence[str], value: Any, source: str) -> None:
    *parents, key = keys
    for parent in parents:
        tables = tables.setdefault(parent, {})
        if not isinstance(tables, dict):
            raise SettingsError(f"{source}: {parent} is set to a value before")
    tables[key] = value


def _parse_value(text: str, source: str) -> Any:
    try:
        with bounded(source):
            document = tomllib.loads(f"value = {text}")
    except InputError as error:
        raise SettingsError(str(error)) from None
    except (ValueError, RecursionError):  # TOMLDecodeError, or an int with too many digits
        return text.strip()
    # A line break in the text could add further keys.
    return document["value"] if len(document) == 1 else text


def _merge(
    below: dict[str, Any],
    above: Mapping[str, Any],
    source: str,
    path: KeyPath,
    sources: dict[KeyPath, str],
) -> None:
    """Merge ``above`` into ``below``, and write the source of each key into ``sources``.

    ``path``  of both tables; the source of a table is all sources of its keys
    """
    sources[path] = f"{sources[path]}, {source}" if below else source
    for key, value in above.items():
        old = below.get(key)
        if isinstance(value, dict):
            keep = isinstance(old, dict) and value.get(_KIND, old.get(_KIND)) == old.get(_KIND)
            below[key] = old if keep else {}
            _merge(below[key], value, source, (*path, key), sources)
        else:
            below[key] = value
            sources[(*path, key)] = source
