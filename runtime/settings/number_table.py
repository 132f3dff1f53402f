"""Tables of numbers that users bring: CSV as spreadsheets, loggers and scripts write it.

The first row that is neither empty nor a comment names the columns, in small letters or capitals.
Accepted are byte order marks, any line ends, blanks around cells, empty lines, comments after
``#``, further columns, and semicolons, tabs or blanks between the cells, with which a comma may
stand for the decimal point.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from textwrap import shorten
from typing import NamedTuple, TypeVar

from .settings import SettingsError, read_text

Cell = TypeVar("Cell")
_COMMENT = re.compile(r"\s+#[^,;\t]*$")
"""Not the beginning of a cell that others follow."""
_SHOWN_MAX = 60
"""Characters of a mistaken row that a message shows."""


class TableRow(NamedTuple):
    """One row of a table: its line in the file, and the cells of the columns asked for."""

    line: int
    cells: tuple[str, ...]


def read_number_table(
    file: Path, layouts: Sequence[tuple[str, ...]]
) -> tuple[tuple[str, ...], list[TableRow]]:
    """Return the columns found, which are one of ``layouts``, and the rows with these columns.

    ``layouts``  names of columns that are sought together, the first that are all there are taken

    Raises SettingsError, which names the file, and the line where there is one.
    """
    rows, line, names, separator = _opened(file)
    layout = next((wanted for wanted in layouts if set(wanted) <= set(names)), None)
    if layout is None:
        allowed = " or ".join(",".join(wanted) for wanted in layouts)
        where = f", line {line}" if line else ""
        raise SettingsError(f"{file}{where}: the first line must name the columns {allowed}")
    places = [names.index(name) for name in layout]
    table = []
    for line, text in rows:
        cells = _cells(text, separator)
        cells += [""] * (len(names) - len(cells))
        while len(cells) > len(names) and not cells[-1]:
            del cells[-1]
        if separator != ",":
            cells = [cell.replace(",", ".") for cell in cells]
        if len(cells) > len(names):
            raise SettingsError(f"{file}, line {line}: has {len(cells)} cells, not {len(names)}")
        table.append(TableRow(line, tuple(cells[place] for place in places)))
    return layout, table


def column_names(file: Path) -> tuple[str, ...]:
    """Return the names of all columns, in small letters; raises SettingsError."""
    return tuple(_opened(file)[2])


def _opened(file: Path) -> tuple[Iterator[tuple[int, str]], int, list[str], str | None]:
    """Return the rows behind the header, its line, the names in it, and what separates cells."""
    rows = _rows(read_text(file).split("\n"))
    line, header = next(rows, (0, ""))
    between_blanks = None if len(header.split()) > 1 else ","
    separator = next((mark for mark in ";\t," if mark in header), between_blanks)
    return rows, line, _cells(header.lower(), separator), separator


def convert_cells(
    file: Path, rows: Sequence[TableRow], convert: Callable[[str], Cell], wanted: str
) -> Iterator[tuple[Cell, ...]]:
    """Yield the converted cells of each row.

    ``convert``  raises ValueError for a cell that it does not take
    ``wanted``   what a row must hold, for the message

    Raises SettingsError, which names the line.
    """
    for line, cells in rows:
        try:
            yield tuple(map(convert, cells))
        except ValueError:
            shown = shorten(",".join(cells), _SHOWN_MAX, placeholder="...")
            raise SettingsError(f"{file}, line {line}: must be {wanted}, not {shown!r}") from None


def _rows(lines: Sequence[str]) -> Iterator[tuple[int, str]]:
    for number, line in enumerate(lines, start=1):
        if line.strip() and not line.lstrip().startswith("#"):
            yield number, _COMMENT.sub("", line)


def _cells(text: str, separator: str | None) -> list[str]:
    return [cell.strip().strip('"') for cell in text.split(separator)]
