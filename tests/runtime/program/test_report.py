"""Reports on disk: whole or not at all, and readable by any JSON reader."""

import json
import math
import os
from pathlib import Path

import pytest

from steer_by_wire.runtime.node.real_time_loop import LoopFigures
from steer_by_wire.runtime.node.statistics import DurationSummary
from steer_by_wire.runtime.program.report import loop_report, write_json

SUMMARY = DurationSummary(
    samples=2, mean_ns=1_500_000.0, p50_ns=1_000_000, p99_ns=2_000_000, max_ns=2_000_000
)


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


@pytest.mark.parametrize(("duration_ns", "fraction"), [(2_000_000_000, 0.25), (0, 0.0)])
def test_a_loop_is_reported_with_the_share_of_time_it_worked(
    duration_ns: int, fraction: float
) -> None:
    figures = LoopFigures(
        lateness=SUMMARY,
        overdue=1,
        wake_ups=2,
        full_wake_ups=0,
        frames_received=3,
        frames_sent=4,
        frames_refused=0,
        duration_ns=duration_ns,
        busy_ns=500_000_000,
    )
    report = loop_report(figures)
    assert report["busy_fraction"] == fraction
    assert report["duration_s"] == duration_ns / 1e9
    assert report["overdue"] == 1
