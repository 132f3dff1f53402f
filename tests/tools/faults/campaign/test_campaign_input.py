"""Bad input of the fault campaign: impossible specifications, and another's folder."""

from pathlib import Path

import pytest

from steer_by_wire.runtime.settings import SettingsError, load_settings
from steer_by_wire.tools.faults.campaign.campaign_file import CampaignSettings
from steer_by_wire.tools.faults.program import main

TINY = """
motion_s = 1.0
onset_s = 0.5
fault_s = 0.1
golden_seeds = 1
laws = ["practical_pd"]
"""


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
        ('points=[{name="a",laws=["x","x"]}]', "laws of a must differ: 'x' is there 2 times"),
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


def test_results_of_another_specification_are_not_lost(
    spec_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first = tmp_path / "first"
    words = [str(spec_file), "--workers", "1", "--out"]
    assert main([*words, str(first)]) != 2  # what it shows is not asked here
    kept = (first / "results.csv").read_text()
    capsys.readouterr()
    assert main([*words, str(first), "--set", "seed=2"]) == 2
    reported = capsys.readouterr().err
    assert "has another run, whose specification.toml differs" in reported
    assert len(reported.splitlines()) == 1
    assert (first / "results.csv").read_text() == kept
    again = load_settings(CampaignSettings, file=first / "specification.toml")
    assert again == load_settings(CampaignSettings, file=spec_file)
    assert main([*words, str(spec_file)]) == 2
    assert "is a file: give the name of a folder" in capsys.readouterr().err
