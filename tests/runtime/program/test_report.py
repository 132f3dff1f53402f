"""Reports on disk: whole or not at all, and readable by any JSON reader."""

import json
import math
import os
from pathlib import Path

import pytest

from steer_by_wire.runtime.program.report import write_json


def test_numbers_that_json_does_not_have_become_null_however_deep(tmp_path: Path) -> None:
    file = tmp_path / "report.json"
    write_json(file, {"a": math.nan, "b": [1.5, (math.inf, -math.inf)], "c": {"d": math.nan}})
    expected = {"a": None, "b": [1.5, [None, None]], "c": {"d": None}}
    assert json.loads(file.read_text(), parse_constant=pytest.fail) == expected


def test_what_cannot_be_written_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    file = tmp_path / "report.json"
    write_json(file, {"run": 1})
    with pytest.raises(TypeError):
        write_json(file, {"run": object()})
    assert json.loads(file.read_text()) == {"run": 1}
    assert os.listdir(tmp_path) == ["report.json"]


def test_a_link_still_links_after_a_report_is_written_to_it(tmp_path: Path) -> None:
    target, link = tmp_path / "target.json", tmp_path / "link.json"
    target.write_text("{}")
    link.symlink_to(target)
    write_json(link, {"run": 1})
    assert link.is_symlink()
    assert json.loads(target.read_text()) == {"run": 1}


def test_what_is_no_file_is_written_to_and_not_replaced(tmp_path: Path) -> None:
    """A report to /dev/null, written as root, must not make a file of /dev/null."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    try:
        write_json(pipe, {"run": 1})
        assert pipe.is_fifo()
        assert json.loads(os.read(reader, 1000)) == {"run": 1}
    finally:
        os.close(reader)
