"""Bad input of the fault campaign: impossible specifications, and foreign results."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from steer_by_wire.runtime.settings import SettingsError, load_settings
from steer_by_wire.tools.faults.campaign.campaign_file import CampaignSettings
from steer_by_wire.tools.faults.campaign.execution import (
    RESULTS,
    read_stored,
    specification_hash,
    write_result,
)
from steer_by_wire.tools.faults.campaign.virtual_trial import RunResult
from steer_by_wire.tools.faults.program import main
from tests.fuzz.campaign_targets import whole_result

TINY = """
motion_s = 1.0
onset_s = 0.5
fault_s = 0.1
golden_seeds = 1
laws = ["practical_pd"]
"""


@pytest.fixture(scope="module")
def result() -> RunResult:
    return whole_result()


@pytest.fixture
def spec_file(tmp_path: Path) -> Path:
    file = tmp_path / "tiny.toml"
    file.write_text(TINY)
    return file


def case(text: str) -> str:
    return f"cases=[{{{text}}}]"


@pytest.mark.parametrize(
    ("override", "reported"),
    [
        (
            case('kind="burst_loss",messages=["LATERAL_ERROR"],magnitudes=[3.5]'),
            "magnitude of burst_loss (frames in a burst) must be 1 to 1000, whole, not 3.5",
        ),
        (
            case('kind="stuck",messages=["CONTROLLER_SAFETY"],magnitudes=[1.0]'),
            "stuck needs a quantity, and CONTROLLER_SAFETY has none",
        ),
        (
            case('kind="drop",signal="steer_rad",messages=["STEERING_COMMAND"],magnitudes=[1.0]'),
            "drop changes no single signal: leave signal out",
        ),
        (
            case('kind="offset",messages=["STEERING_COMMAND"],magnitudes=[1.0,1.0000001]'),
            "cases must differ: 'offset 1 STEERING_COMMAND' is there 2 times",
        ),
        ('node_cases=[{kind="clock_jump",nodes=["controller"],magnitudes=[1e-10]}]', "1e-10"),
        ('node_cases=[{kind="killed",nodes=["plant"],magnitudes=[]}]', "magnitudes"),
        ('laws=["practical_pd","practical_pd"]', "laws must differ"),
        (
            'points=[{name="a",laws=["paper_pd","paper_pd"]}]',
            "laws of a must differ: 'paper_pd' is there 2 times",
        ),
        (
            'laws=["practical_pd","practical_pdd"]',
            'command line: laws[1] = "practical_pdd": there is no preset of this name (did you mean'
            " practical_pd?)",
        ),
        (
            'points=[{name="a",laws=["nope"]}]',
            'command line: points[0].laws[0] = "nope": there is no preset of this name (known: ',
        ),
        ('points=[{name="a\\tb"}]', "must be printable"),
        ('points=[{name="a",path={kind="spiral"}}]', "points"),
    ],
)
def test_what_no_run_could_have_is_refused_in_one_line(override: str, reported: str) -> None:
    with pytest.raises(SettingsError) as raised:
        load_settings(CampaignSettings, overrides=[override])
    assert len(raised.value.mistakes) == 1
    assert reported in str(raised.value)


def test_a_clock_jump_at_the_bound_is_allowed() -> None:
    jump = 'node_cases=[{kind="clock_jump",nodes=["controller"],magnitudes=[0.001]}]'
    assert load_settings(CampaignSettings, overrides=[jump]).node_cases[0].magnitudes == (0.001,)


def line_of(result: RunResult, **changes: Any) -> str:
    return json.dumps({"specification": "a", **result._asdict(), **changes})


@pytest.mark.parametrize(
    "changes",
    [
        {"name": [1, 2]},
        {"name": "\x1b[2J"},
        {"fhti_s": "abc"},
        {"counts": 7},
        {"counts": {"plant.lost": None}},
        {"changed": None},
        {"changed": [-1]},
        {"seed": 2**70},
        {"verdict": "fine"},
        {"magnitude": float("nan")},
        {"further": 1},
    ],
)
def test_a_result_with_a_field_that_is_none_of_its_kind_is_left_out(
    result: RunResult, changes: dict[str, Any], tmp_path: Path
) -> None:
    lines = [line_of(result), line_of(result, **changes)]
    (tmp_path / RESULTS).write_text("\n".join(lines))
    assert read_stored(tmp_path, "a") == ([("a", result)], 0, 1)


@pytest.mark.parametrize(
    "line", [b"\xff\xfe", b"7", b"[]", b"null", b"{}", b"[" * 100_000, b"x" * 3_000_000, b'{"a":1}']
)
def test_a_line_that_is_no_result_costs_none_of_the_others(
    result: RunResult, line: bytes, tmp_path: Path
) -> None:
    write_result(tmp_path, "a", result)
    with (tmp_path / RESULTS).open("ab") as file:
        file.write(line + b"\n")
    write_result(tmp_path, "a", result)
    stored = read_stored(tmp_path, "a")
    assert stored.results == [("a", result)] * 2
    assert stored.not_whole >= 1


def test_results_of_another_specification_are_not_lost(
    spec_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first = str(tmp_path / "first")
    words = [str(spec_file), "--workers", "1", "--out"]
    assert main([*words, first]) != 2  # what it shows is not asked here
    kept = (tmp_path / "first" / RESULTS).read_text()
    capsys.readouterr()
    assert main([*words, first, "--set", "seed=2"]) == 2
    reported = capsys.readouterr().err
    assert "has 1 results of another specification" in reported
    assert len(reported.splitlines()) == 1
    assert (tmp_path / "first" / RESULTS).read_text() == kept
    assert main([*words, str(spec_file)]) == 2
    assert "is a file: give the name of a folder" in capsys.readouterr().err


def test_results_that_programs_of_before_have_written_otherwise_are_not_lost_either(
    result: RunResult, spec_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A line with a field that there is no more cannot be read, and is another's all the same."""
    (tmp_path / RESULTS).write_text(line_of(result, further=1) + "\n")
    assert main([str(spec_file), "--out", str(tmp_path)]) == 2
    assert "another specification" in capsys.readouterr().err
    assert "further" in (tmp_path / RESULTS).read_text()


def test_a_line_that_was_cut_is_reported_and_its_run_made_again(
    spec_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    words = [str(spec_file), "--workers", "1", "--out", str(out)]
    assert main(words) != 2
    whole = (out / RESULTS).read_text()
    shutil.copytree(out, tmp_path / "cut")
    (out / RESULTS).write_text(whole[:-40])
    capsys.readouterr()
    assert main(words) != 2
    printed = capsys.readouterr()
    assert "1 lines that are no whole results are left out" in printed.err
    assert (out / RESULTS).read_text() == whole


def test_the_state_of_the_programs_is_found_from_any_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    here = specification_hash(CampaignSettings())
    monkeypatch.chdir(tmp_path)
    assert specification_hash(CampaignSettings()) == here
