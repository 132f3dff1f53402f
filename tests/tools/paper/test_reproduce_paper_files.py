"""Summaries of earlier reproductions that are damaged: one line that names the file."""

import json
from pathlib import Path
from typing import Any

import pytest

from steer_by_wire.runtime.settings import SettingsError
from steer_by_wire.tools.paper.result import (
    Comparison,
    Reproduction,
    Verdict,
    read_written,
    write_reproduction,
)

KEY = "table_9"
WHOLE = Reproduction(
    key=KEY,
    title="a table",
    caption="",
    pictures=(),
    comparisons=(Comparison("rms", "1 m", "1.1 m", None),),
    verdict=Verdict.REPRODUCED,
    why="",
)


def test_a_summary_is_read_as_it_was_written(tmp_path: Path) -> None:
    written = write_reproduction(WHOLE, tmp_path)
    assert read_written(tmp_path, [KEY, "figure_9"]) == [written]


@pytest.mark.parametrize(
    "changes",
    [
        {"title": [1]},
        {"pictures": "x"},
        {"pictures": [7]},
        {"comparisons": {}},
        {"comparisons": [{"quantity": 1, "published": "", "reproduced": "", "agrees": None}]},
        {"verdict": "fine"},
        {"further": 1},
    ],
)
def test_a_summary_with_a_part_that_is_none_of_its_kind_is_reported(
    changes: dict[str, Any], tmp_path: Path
) -> None:
    write_reproduction(WHOLE, tmp_path)
    file = tmp_path / f"{KEY}.json"
    file.write_text(json.dumps(json.loads(file.read_text()) | changes))
    with pytest.raises(SettingsError, match=rf"{KEY}\.json: is not a summary"):
        read_written(tmp_path, [KEY])


@pytest.mark.parametrize("content", [b"", b"\xff\xfe", b"[]", b"[" * 100_000])
def test_a_summary_that_is_no_json_is_reported(content: bytes, tmp_path: Path) -> None:
    (tmp_path / f"{KEY}.json").write_bytes(content)
    with pytest.raises(SettingsError, match=rf"{KEY}\.json: is not a summary"):
        read_written(tmp_path, [KEY])
