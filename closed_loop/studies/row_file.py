"""A Parquet file of a study's rows, with Parquet's own checksums and a digest of its study."""

import hashlib
import importlib
from collections.abc import Iterable, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

from ...runtime.command_line import installation
from ...runtime.output_file import write_whole
from ...runtime.settings import SettingsError

_KEY = b"study"


def pyarrow() -> tuple[ModuleType, ModuleType]:
    """Return pyarrow and pyarrow.parquet; raises SettingsError where they are missing."""
    try:
        return importlib.import_module("pyarrow"), importlib.import_module("pyarrow.parquet")
    except ImportError as error:
        raise SettingsError(
            f"results are stored as Parquet, which needs pyarrow: {installation('pyarrow')}"
        ) from error


def write_rows(file: Path, record: bytes, schema: Any, tables: Iterable[Any]) -> None:
    """Write tables of this schema, one after another, into one file; raises OSError."""
    _, parquet = pyarrow()
    metadata = {_KEY: _digest(record)}

    def write(place: Path) -> None:
        marked = schema.with_metadata(metadata)
        with parquet.ParquetWriter(
            place, marked, compression="zstd", write_page_checksum=True
        ) as writer:
            for table in tables:
                writer.write_table(table.replace_schema_metadata(metadata))

    write_whole(file, write)


def read_table(
    file: Path,
    record: bytes,
    columns: Sequence[str] | None = None,
    filters: Sequence[tuple[str, str, Any]] | None = None,
) -> Any:
    """Return a file's rows as a table; raises SettingsError where it is damaged or another's.

    ``columns``  all by default
    ``filters``  which rows, in pyarrow's form; all by default
    """
    _, parquet = pyarrow()
    count_rows(file, record)
    chosen = None if filters is None else [*filters]
    try:
        return parquet.read_table(
            file, columns=columns, filters=chosen, page_checksum_verification=True
        )
    except (OSError, ValueError) as error:
        raise _damaged(file, str(error)) from error


def count_rows(file: Path, record: bytes) -> int:
    """Return how many rows a file has; raises SettingsError as ``read_table``."""
    _, parquet = pyarrow()
    try:
        found = parquet.read_metadata(file)
        is_own = (found.metadata or {}).get(_KEY) == _digest(record)
    except (OSError, ValueError) as error:  # ValueError for what is no Parquet
        raise _damaged(file, str(error)) from error
    if not is_own:
        raise _damaged(file, "its rows are of another study")
    return int(found.num_rows)


def _damaged(file: Path, why: str) -> SettingsError:
    text = f"{file}: {' '.join(why.split())}; remove it, and the study computes its rows again"
    return SettingsError(text)


def _digest(record: bytes) -> bytes:
    return hashlib.sha256(record).hexdigest().encode()
