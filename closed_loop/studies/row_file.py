"""A Parquet file of a study's rows, with one digest that binds it to its study.

    digest = SHA-256(record of the study, all bytes of the file but the digest's own)

The digest stands in the file's metadata. Every reading checks it: a flipped bit anywhere in the
file, and the rows of another study, raise a SettingsError of one line.
"""

import hashlib
import importlib
import mmap
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

from ...runtime.command_line import installation
from ...runtime.output_file import write_whole
from ...runtime.settings import SettingsError

_MARK = b"sha256:"
_BLANK = b"0" * 64
_METADATA = {"digest": _MARK + _BLANK}


def pyarrow() -> tuple[ModuleType, ModuleType]:
    """Return pyarrow and pyarrow.parquet; raises SettingsError where they are missing."""
    try:
        return importlib.import_module("pyarrow"), importlib.import_module("pyarrow.parquet")
    except ImportError as error:
        raise SettingsError(
            f"results are stored as Parquet, which needs pyarrow: {installation('pyarrow')}"
        ) from error


def write_rows(file: Path, record: bytes, tables: Sequence[Any]) -> None:
    """Write tables with the same columns, one after another, into one file; raises OSError."""
    _, parquet = pyarrow()

    def write(place: Path) -> None:
        marked = tables[0].schema.with_metadata(_METADATA)
        with parquet.ParquetWriter(place, marked, compression="zstd") as writer:
            for table in tables:
                writer.write_table(table.replace_schema_metadata(_METADATA))
        with place.open("r+b") as stream, mmap.mmap(stream.fileno(), 0) as content:
            first = content.rfind(_MARK) + len(_MARK)
            content[first : first + len(_BLANK)] = _digest(record, content, first)

    write_whole(file, write)


def read_table(file: Path, record: bytes, columns: Sequence[str] | None = None) -> Any:
    """Return a file's rows as a table, after a check of its digest; raises SettingsError.

    ``columns``  all by default
    """
    _, parquet = pyarrow()
    check(file, record)
    return parquet.read_table(file, columns=columns)


def check(file: Path, record: bytes) -> None:
    """Refuse a damaged file, and the rows of another study; raises SettingsError."""
    try:
        with (
            file.open("rb") as stream,
            mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as content,
        ):
            first = content.rfind(_MARK) + len(_MARK)
            is_own = content[first : first + len(_BLANK)] == _digest(record, content, first)
    except (OSError, ValueError) as error:  # ValueError for an empty file
        raise SettingsError(f"{file}: results cannot be read: {error}") from error
    if not is_own:
        raise SettingsError(
            f"{file}: damaged, or of another study; remove it, and the study computes its rows "
            "again"
        )


def _digest(record: bytes, content: mmap.mmap, first: int) -> bytes:
    """Return the digest of a file but for the place of the digest, which is at ``first``."""
    found = hashlib.sha256(record)
    with memoryview(content) as view:
        found.update(view[:first])
        found.update(view[first + len(_BLANK) :])
    return found.hexdigest().encode()
