"""A program as the controller of a campaign is judged by what it reports on the bus."""

import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from steer_by_wire.runtime.settings import load_settings
from steer_by_wire.tools.faults.campaign.campaign_file import CampaignSettings
from steer_by_wire.tools.faults.campaign.campaign_runs import Scenario, scenarios_of
from steer_by_wire.tools.faults.campaign.execution import specification_hash
from steer_by_wire.tools.faults.campaign.virtual_trial import Detection, RunResult, run_trial

OURS = [sys.executable, "-m", "tests.closed_loop.lockstep.lockstep_controller"]
OURS += ["practical_pd_ddob"]
ROOT = Path(__file__).parents[4]
SILENT = [*map(str, (sys.executable, ROOT / "examples/foreign_controller.py"))]
SILENT += [str(ROOT / "dbc/steer_by_wire.dbc"), "--lockstep"]
SPEC = """
golden_seeds = 1
motion_s = 4.0
cases = [
  { kind = "drop", messages = ["LATERAL_ERROR"], magnitudes = [1.0] },
  { kind = "bit_flips", messages = ["LATERAL_ERROR", "STEERING_COMMAND"], magnitudes = [0.02] },
]
node_cases = [
  { kind = "killed", nodes = ["controller"] },
  { kind = "clock_jump", nodes = ["controller"], magnitudes = [1.0] },
]
"""
OF_MEASUREMENTS = """
golden_seeds = 1
motion_s = 4.0
cases = [
  { kind = "stuck", messages = ["LATERAL_ERROR"], magnitudes = [1.0] },
]
node_cases = []
"""


def trials(
    folder: Path, text: str, words: Sequence[str] = ()
) -> Iterator[tuple[Scenario, RunResult]]:
    """Yield the runs of a specification, with a program as the controller if given."""
    file = folder / "spec.toml"
    file.write_text(text, encoding="utf-8")
    overrides = [f"command={json.dumps(words)}"] if words else []
    spec = load_settings(CampaignSettings, None, file, overrides)
    return ((scenario, run_trial(scenario)) for scenario in scenarios_of(spec))


def test_our_controller_as_a_program_is_judged_as_it_is_within(tmp_path: Path) -> None:
    within, outside = [*trials(tmp_path, SPEC)], [*trials(tmp_path, SPEC, OURS)]
    assert [one.verdict for _, one in outside] == [one.verdict for _, one in within]
    for (scenario, own), (_, other) in zip(within, outside, strict=True):
        assert other.lateral_error_peak_m == own.lateral_error_peak_m, scenario.name
        assert other.recovery_s == own.recovery_s, scenario.name
    by_frames = {one.where: one.detected_by for _, one in outside if one.kind == "bit_flips"}
    assert by_frames["LATERAL_ERROR"] == "controller.rejected"
    assert by_frames["STEERING_COMMAND"] == "plant.bad_crc"
    assert all(one.corrupted == 0 for _, one in outside if one.where == "LATERAL_ERROR")


def test_one_that_sends_its_commands_alone_detects_nothing(tmp_path: Path) -> None:
    golden, alone = (one for _, one in trials(tmp_path, OF_MEASUREMENTS, SILENT))
    assert golden.verdict == Detection.PASSED
    assert alone.detected_by == ""
    assert alone.verdict != Detection.PASSED


def test_one_that_fails_is_unsafe_and_says_why(tmp_path: Path) -> None:
    failing = [sys.executable, "-c", "raise SystemExit('no board')"]
    _, golden = next(trials(tmp_path, SPEC, failing))
    assert golden.verdict == Detection.UNSAFE
    assert golden.unsafe.endswith("ended with status 1; its last line: no board")


def test_results_of_another_program_belong_to_another_specification(tmp_path: Path) -> None:
    program = tmp_path / "firmware"
    spec = CampaignSettings(command=(str(program),))
    program.write_text("one", encoding="utf-8")
    before = specification_hash(spec)
    assert specification_hash(spec) == before
    program.write_text("two", encoding="utf-8")
    assert specification_hash(spec) != before
