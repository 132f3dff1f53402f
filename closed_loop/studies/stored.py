"""Reads the files of a study, to which anything may have happened since.

A damaged file, or one of another program, raises a SettingsError of one line.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ...runtime.settings import SettingsError

_WHAT_TO_DO = "remove it, and the study computes its content again"
_CAUSE_LENGTH_MAX = 160


def read_json(file: Path) -> Any:
    """Return the content of a JSON file; raises OSError, and SettingsError for invalid JSON."""
    try:
        return json.loads(file.read_bytes())
    except (ValueError, RecursionError) as error:  # ValueError covers UnicodeDecodeError
        raise SettingsError(f"{file}: is not JSON: {_cause(error)}") from error


def check_columns(file: Path, types: Mapping[str, Any]) -> int:
    """Return the number of rows of a Parquet file that has these columns; raises SettingsError."""
    from pyarrow import ArrowException, parquet

    try:
        metadata = parquet.read_metadata(file)
        schema = metadata.schema.to_arrow_schema()
    except (ArrowException, OSError) as error:
        raise _damaged(file, _cause(error)) from error
    for name, kind in types.items():
        place = schema.get_field_index(name)  # -1 for a duplicate name, too
        if place < 0:
            raise _damaged(file, f"has no column {name}")
        if schema.field(place).type != kind:
            raise _damaged(file, f"column {name} is {schema.field(place).type}, not {kind}")
    return int(metadata.num_rows)


def read_columns(
    file: Path, types: Mapping[str, Any], filters: Sequence[tuple[str, str, Any]] | None = None
) -> Any:
    """Return these columns as a table without gaps; raises SettingsError.

    ``types``    pyarrow's, by column
    ``filters``  which rows, in pyarrow's form; without any, all rows
    """
    from pyarrow import ArrowException, parquet

    check_columns(file, types)
    try:
        table = parquet.read_table(
            file, columns=[*types], filters=None if filters is None else [*filters]
        )
    except (ArrowException, OSError) as error:
        raise _damaged(file, _cause(error)) from error
    for name in types:
        if table[name].null_count:
            raise _damaged(file, f"column {name} has gaps")
    return table


def overrides_of(text: str, where: str) -> dict[str, Any]:
    """Return the overrides of a run, by dotted key; raises SettingsError.

    ``where``  names the place for the error message
    """
    try:
        found = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise SettingsError(f"{where}: overrides are not JSON: {_cause(error)}") from error
    if not isinstance(found, dict) or not isinstance(found.get("plant.seed"), int):
        raise SettingsError(f"{where}: overrides are no table with a plant.seed")
    return found


def _damaged(file: Path, what: str) -> SettingsError:
    return SettingsError(f"{file}: results cannot be read: {what}; {_WHAT_TO_DO}")


def _cause(error: Exception) -> str:
    return " ".join(str(error).split())[:_CAUSE_LENGTH_MAX]
