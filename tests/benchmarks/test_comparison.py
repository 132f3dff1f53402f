"""A benchmark beside a saved one: what is named slower, and what is not."""

import json
from pathlib import Path

import pytest

from benchmarks.__main__ import main
from benchmarks.comparison import SLOWER, changes, comparison_text, read_ratios
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.settings import SettingsError


def saved(path: Path, ratios: dict[str, float]) -> Path:
    """Write what ``--json`` writes, as far as it is compared."""
    lines = [{"name": name, "ratio_to_calibration": ratio} for name, ratio in ratios.items()]
    path.write_text(json.dumps({"lines": lines}), encoding="utf-8")
    return path


def test_what_is_slower_is_named_and_the_worst_comes_first() -> None:
    before = {"a": 1.0, "b": 2.0, "c": 3.0, "d": 4.0}
    now = {"a": 1.0, "b": 2.0 * SLOWER * 1.01, "c": 9.0, "d": 1.0}
    assert [change.name for change in changes(before, now)] == ["c", "b", "a", "d"]
    assert comparison_text(before, now).splitlines() == [
        "slower: c, 3.00 times what it was",
        "slower: b, 1.31 times what it was",
    ]


def test_noise_and_what_got_faster_are_not_slower() -> None:
    text = comparison_text({"a": 1.0, "b": 2.0}, {"a": 0.99 * SLOWER, "b": 0.2})
    assert text == "nothing is slower by more than 1.3 times"


def test_what_only_one_of_the_two_has_is_named() -> None:
    lines = comparison_text({"a": 1.0, "old": 1.0}, {"a": 1.0, "fresh": 1.0}).splitlines()
    assert lines[1:] == ["new: fresh", "gone: old"]


def test_a_saved_benchmark_is_read_back(tmp_path: Path) -> None:
    assert read_ratios(saved(tmp_path / "saved.json", {"a": 1.5})) == {"a": 1.5}


@pytest.mark.parametrize(
    "text",
    ["", "[]", "{}", '{"lines": [{}]}', '{"lines": [{"name": 1, "ratio_to_calibration": 0}]}'],
)
def test_another_file_is_refused_in_one_line_before_anything_is_timed(
    text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "other.json"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(SettingsError):
        read_ratios(file)
    assert main(["loop", "--against", str(file)]) == ExitStatus.SETTINGS
    error = f"python -m benchmarks: error: {file}: not a saved benchmark\n"
    assert capsys.readouterr().err == error
