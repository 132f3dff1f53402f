"""The campaign on messages whose age is only reported: detected in time, and control is kept."""

import pytest

from steer_by_wire.runtime.settings import load_settings
from steer_by_wire.tools.faults.campaign.campaign_file import CampaignSettings
from steer_by_wire.tools.faults.campaign.campaign_runs import scenarios_of
from steer_by_wire.tools.faults.campaign.virtual_trial import Detection, RunResult, run_trial

SPECIFICATION = """
motion_s = 3.0
onset_s = 1.0
fault_s = 0.5
golden_seeds = 1
laws = ["practical_predictor"]
[[points]]
name = "delay"
speed_m_s = 1.9444444444444444
downlink_ms = 60.0
uplink_ms = 40.0
[[cases]]
kind = "drop"
messages = ["STEERING_STATUS", "VEHICLE_STATE"]
magnitudes = [1.0]
[[cases]]
kind = "delay_spike"
messages = ["STEERING_STATUS", "VEHICLE_STATE"]
magnitudes = [0.3]
[[cases]]
kind = "bit_flips"
messages = ["STEERING_STATUS"]
magnitudes = [0.5]
"""


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> list[RunResult]:
    file = tmp_path_factory.mktemp("ages") / "ages.toml"
    file.write_text(SPECIFICATION)
    specification = load_settings(CampaignSettings, None, file, [])
    return [run_trial(scenario) for scenario in scenarios_of(specification)]


def test_silence_of_a_message_the_law_can_do_without_is_detected_and_reported_in_time(
    results: list[RunResult],
) -> None:
    silent = [one for one in results if one.kind in ("drop", "delay_spike")]
    assert len(silent) == 4
    for one in silent:
        assert one.verdict is Detection.PASSED, one
        assert one.detected_by == "controller.stale"
        assert one.reported_s is not None
        assert 0.1 < one.reported_s <= 0.15
        assert "controller.silence" not in one.counts
        assert one.recovery_s == 0.0  # control was never left


def test_a_refused_frame_is_reported_by_the_controller_in_time(results: list[RunResult]) -> None:
    (flipped,) = (one for one in results if one.kind == "bit_flips")
    assert flipped.verdict is Detection.PASSED
    assert flipped.detected_by == "controller.bad_crc"
    assert flipped.reported_s is not None
    assert flipped.reported_s <= 0.15


def test_a_run_without_a_fault_counts_no_message_as_stale(results: list[RunResult]) -> None:
    (golden,) = (one for one in results if one.verdict is Detection.PASSED and not one.counts)
    assert golden.kind == "golden"
