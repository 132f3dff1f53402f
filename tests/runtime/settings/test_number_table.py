"""Tables of numbers: whatever spreadsheets and editors do to a CSV, the numbers are the same."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.runtime.settings import SettingsError
from steer_by_wire.runtime.settings.number_table import convert_cells, read_number_table

ENCODINGS = ("utf-8", "utf-8-sig", "utf-16")


@given(
    rows=st.lists(st.tuples(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6)), min_size=1, max_size=8),
    encoding=st.sampled_from(ENCODINGS),
    end=st.sampled_from(["\n", "\r\n", "\r"]),
    separator=st.sampled_from([",", ", ", " ,", ";", "\t", "  "]),
    note=st.sampled_from(["", "  # by hand"]),
    has_further=st.booleans(),
    empty_at=st.integers(0, 8),
    comment_at=st.integers(0, 8),
)
def test_the_form_of_a_table_does_not_matter(
    tmp_path_factory: pytest.TempPathFactory,
    rows: list[tuple[float, float]],
    encoding: str,
    end: str,
    separator: str,
    note: str,
    has_further: bool,
    empty_at: int,
    comment_at: int,
) -> None:
    cells = [["x_m", "y_m"], *[[repr(x), repr(y)] for x, y in rows]]
    if has_further:
        cells = [[row[0], "note", row[1]] for row in cells]
    if separator == ";":
        cells = [[cell.replace(".", ",") for cell in row] for row in cells]
    lines = [separator.join(row) + note for row in cells]
    lines[0] = lines[0].upper() if note else lines[0]
    lines.insert(min(empty_at, len(lines)), "")
    lines.insert(min(comment_at, len(lines)), "# from a logger")
    file = tmp_path_factory.getbasetemp() / "table.csv"
    file.write_bytes((end.join(lines) + end).encode(encoding))
    names, read = read_number_table(file, (("x_m", "y_m"),))
    assert names == ("x_m", "y_m")
    assert [*convert_cells(file, read, float, "two numbers")] == rows


def test_a_mistaken_cell_is_named_by_its_line(tmp_path: Path) -> None:
    file = tmp_path / "table.csv"
    file.write_text("# a comment\nx_m,y_m\n\n1,2\n3,four\n")
    _, rows = read_number_table(file, (("x_m", "y_m"),))
    with pytest.raises(SettingsError, match=r"line 5: must be two numbers, not '3,four'"):
        list(convert_cells(file, rows, float, "two numbers"))


def test_a_table_without_the_columns_says_which_it_needs(tmp_path: Path) -> None:
    file = tmp_path / "table.csv"
    file.write_text("lat,lon\n1,2\n")
    with pytest.raises(SettingsError, match=r"line 1: the first line must name the columns x,y"):
        read_number_table(file, (("x", "y"),))
