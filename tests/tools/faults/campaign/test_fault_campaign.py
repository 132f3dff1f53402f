"""The fault campaign: classification beforehand, a small campaign."""

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from steer_by_wire.dbc.codec.counter_check import CounterCheck
from steer_by_wire.dbc.codec.counter_rule import CounterResult
from steer_by_wire.plant_emulator.faults.settings import FaultKind, FaultSettings
from steer_by_wire.runtime.settings import load_settings
from steer_by_wire.tools.faults.campaign import watched_pair as pair
from steer_by_wire.tools.faults.campaign.acceptance import findings_of
from steer_by_wire.tools.faults.campaign.campaign_file import CampaignSettings, NodeFaultKind
from steer_by_wire.tools.faults.campaign.campaign_runs import (
    Scenario,
    controller_settings_of,
    scenarios_of,
)
from steer_by_wire.tools.faults.campaign.case_groups import group
from steer_by_wire.tools.faults.campaign.detectability import (
    MECHANISM_OF,
    UNRECEIVED,
    Mechanism,
    Sight,
    expect_fault,
    expect_node_fault,
)
from steer_by_wire.tools.faults.campaign.execution import RESULTS, read_stored, specification_hash
from steer_by_wire.tools.faults.campaign.node_faults import NodeFault
from steer_by_wire.tools.faults.campaign.virtual_trial import (
    FAILURES,
    Detection,
    RunResult,
    run_trial,
)
from steer_by_wire.tools.faults.program import FAILED, main
from tests.support.frames.counter_rules import rule

SIGHT = Sight(0.14, 0.7, 0.01, 0.01, rule(100), rule(100))
SMALL = """
motion_s = 3.0
onset_s = 1.0
fault_s = 0.5
golden_seeds = 1
laws = ["practical_pd"]
[[points]]
name = "delay"
speed_m_s = 1.9444444444444444
downlink_ms = 60.0
uplink_ms = 40.0
[[cases]]
kind = "drop"
messages = ["LATERAL_ERROR", "STEERING_COMMAND"]
magnitudes = [1.0]
[[cases]]
kind = "bit_flips"
messages = ["LATERAL_ERROR", "STEERING_COMMAND"]
magnitudes = [0.5]
[[cases]]
kind = "offset"
messages = ["STEERING_COMMAND"]
magnitudes = [0.03, 1.0]
[[cases]]
kind = "replay"
messages = ["STEERING_COMMAND"]
magnitudes = [0.3]
[[cases]]
kind = "delay_spike"
messages = ["STEERING_COMMAND"]
magnitudes = [0.3]
[[cases]]
kind = "bit_flips"
messages = ["CONTROLLER_SAFETY", "PLANT_STATUS"]
magnitudes = [0.5]
[[cases]]
kind = "spoof"
messages = ["DELAY_STATUS"]
magnitudes = [0.1]
[[node_cases]]
kind = "killed"
nodes = ["controller", "plant"]
[[node_cases]]
kind = "bus_off"
nodes = ["controller"]
[[node_cases]]
kind = "paused"
nodes = ["controller"]
[[node_cases]]
kind = "clock_jump"
nodes = ["controller"]
magnitudes = [0.3]
[[node_cases]]
kind = "babbling"
nodes = ["bus"]
"""


@pytest.fixture(scope="module")
def spec_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("spec") / "small.toml"
    file.write_text(SMALL)
    return file


@pytest.fixture(scope="module")
def spec(spec_file: Path) -> CampaignSettings:
    return load_settings(CampaignSettings, None, spec_file, [])


@pytest.fixture(scope="module")
def results(spec: CampaignSettings) -> list[RunResult]:
    return [run_trial(scenario) for scenario in scenarios_of(spec)]


def of(results: Sequence[RunResult], kind: str, where: str = "") -> list[RunResult]:
    return [one for one in results if one.kind == kind and where in one.where]


def test_a_small_campaign_passes(spec: CampaignSettings, results: list[RunResult]) -> None:
    assert [one.name for one in results if one.verdict in FAILURES] == []
    assert [one for one in findings_of(results, spec.ftti_ms) if not one.holds] == []


def test_silence_is_handled_within_the_ftti_and_not_at_once(results: list[RunResult]) -> None:
    silent = [*of(results, "drop"), *of(results, "killed"), *of(results, "bus_off")]
    assert len(silent) == 5
    for one in silent:
        assert one.fhti_s is not None
        assert 0.05 < one.fhti_s <= 0.150, one.name


def test_the_receiver_of_a_fault_detects_it(results: list[RunResult]) -> None:
    assert {one.detected_by for one in of(results, "drop", "LATERAL")} == {"controller.silence"}
    assert {one.detected_by for one in of(results, "drop", "COMMAND")} == {"plant.silence"}
    assert {one.detected_by.split(".")[0] for one in of(results, "bit_flips", "COM")} == {"plant"}


def test_what_no_node_receives_changes_nothing_whatever_happens_to_it(
    results: list[RunResult],
) -> None:
    names = {"CONTROLLER_STATUS", "CONTROLLER_SAFETY", "DELAY_STATUS", "PLANT_STATUS"}
    unreceived = [one for one in results if one.where in names]
    assert len(unreceived) == 3
    for one in unreceived:
        assert one.changed[0] > 0, one.name
        assert (one.verdict, one.as_golden, one.counts) == (Detection.NOT_DETECTABLE, True, {})
    assert {one.as_golden for one in results if one not in unreceived} == {None}
    # Only a law that steers by a model sends MODEL_STATUS.
    assert names == UNRECEIVED - {"MODEL_STATUS"}


def test_a_run_that_is_not_the_golden_one_is_disturbed(
    spec: CampaignSettings, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A fault of the command, as if nobody listened to it."""
    monkeypatch.setattr(
        "steer_by_wire.tools.faults.campaign.campaign_runs.FaultCase.is_unreceived", True
    )
    scenario = next(one for one in scenarios_of(spec) if one.case.kind == "offset")
    result = run_trial(scenario)
    assert (result.verdict, result.as_golden) == (Detection.DISTURBED, False)


def test_a_plausible_offset_is_not_detectable_and_one_beyond_the_limiter_is(
    results: list[RunResult],
) -> None:
    for one in of(results, "offset"):
        if one.magnitude < 0.5:
            assert (one.verdict, one.counts) == (Detection.NOT_DETECTABLE, {})
        else:
            assert one.detected_by == "plant.intervention"


def test_both_recover_but_from_a_death(results: list[RunResult]) -> None:
    for one in results:
        assert (one.recovery_s is None) == (one.kind == "killed"), one.name


def test_a_run_is_a_function_of_its_scenario(spec: CampaignSettings) -> None:
    scenario = list(scenarios_of(spec))[5]
    assert run_trial(scenario) == run_trial(scenario)


def test_the_campaign_that_is_shipped_has_more_than_a_thousand_runs() -> None:
    text = Path("tools/faults/default.toml")
    spec = load_settings(CampaignSettings, None, Path(__file__).parents[4] / text, [])
    scenarios = list(scenarios_of(spec))
    assert len({scenario.name for scenario in scenarios}) == len(scenarios) > 1000
    assert {scenario.case.kind for scenario in scenarios} == {
        "golden",
        *(kind.value for kind in FaultKind),
        *(kind.value for kind in NodeFaultKind),
    }


@pytest.mark.parametrize(
    ("kind", "message", "magnitude", "mechanisms"),
    [
        (FaultKind.DROP, "LATERAL_ERROR", 0.5, (Mechanism.E2E,)),
        (FaultKind.DROP, "LATERAL_ERROR", 1.0, (Mechanism.FRESHNESS,)),
        (FaultKind.DROP, "VEHICLE_STATE", 1.0, (Mechanism.FRESHNESS,)),
        (FaultKind.DELAY_SPIKE, "LATERAL_ERROR", 0.05, ()),
        (FaultKind.DELAY_SPIKE, "LATERAL_ERROR", 0.3, (Mechanism.FRESHNESS,)),
        (FaultKind.OUT_OF_RANGE, "LATERAL_ERROR", 1.0, (Mechanism.RANGE,)),
    ],
)
def test_detectability_is_decided_by_what_a_fault_is(
    kind: FaultKind, message: str, magnitude: float, mechanisms: tuple[Mechanism, ...]
) -> None:
    direction: Any = "downlink" if message == "STEERING_COMMAND" else "uplink"
    fault = FaultSettings(kind=kind, direction=direction, message=message, magnitude=magnitude)
    assert expect_fault(fault, SIGHT).mechanisms == mechanisms


def test_a_short_pause_is_no_silence() -> None:
    short = NodeFault(NodeFaultKind.PAUSED, "controller", 1.0, 0.1)
    assert expect_node_fault(short, SIGHT).mechanisms == ()
    seen = expect_node_fault(short, SIGHT._replace(age_limit_s=0.09))
    assert seen.mechanisms == (Mechanism.FRESHNESS,)


def scenario_with(spec: CampaignSettings, **changes: Any) -> Scenario:
    scenario = next(one for one in scenarios_of(spec) if one.case.kind == "drop")
    return scenario._replace(spec=spec.model_copy(update=changes))


def test_a_reaction_that_comes_after_the_ftti_is_late(
    spec: CampaignSettings, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pair, "controller_settings_of", lambda law, _: controller_settings_of(law))
    assert run_trial(scenario_with(spec, ftti_ms=50.0)).verdict is Detection.LATE


def test_a_fault_that_nobody_sees_although_it_is_detectable_is_missed(
    spec: CampaignSettings,
) -> None:
    scenario = next(one for one in scenarios_of(spec) if one.case.kind == "offset")
    expected = scenario.case.expected._replace(mechanisms=(Mechanism.E2E,))
    result = run_trial(scenario._replace(case=scenario.case._replace(expected=expected)))
    assert result.verdict is Detection.MISSED
    assert findings_of([result], 150.0)[0].holds is False


def test_every_cause_that_is_counted_has_a_mechanism(results: list[RunResult]) -> None:
    counted = {cause.split(".")[1] for one in results for cause in one.counts}
    assert counted <= MECHANISM_OF.keys()


def test_groups_have_every_run_once(results: list[RunResult]) -> None:
    assert sum(row.runs for row in group(results)) == len(results)


def test_the_program_goes_on_where_it_was_left(
    spec_file: Path, tmp_path: Path, results: list[RunResult], capsys: pytest.CaptureFixture[str]
) -> None:
    """All but two runs are there already, and one line is torn."""
    drop = 'cases=[{kind="drop", messages=["LATERAL_ERROR","STEERING_COMMAND"], magnitudes=[1.0]}]'
    few = ["--set", drop, "--set", "node_cases=[]", "--workers", "1"]
    arguments = [str(spec_file), *few, "--out", str(tmp_path / "now")]
    assert main(arguments) == 0
    lines = (tmp_path / "now" / RESULTS).read_text().splitlines()
    (tmp_path / "now" / RESULTS).write_text("\n".join([*lines[:-2], lines[-2][:40]]))
    capsys.readouterr()
    assert main(arguments) == 0
    printed = capsys.readouterr().out
    assert f"{len(lines) - 2} of {len(lines)} runs are there already" in printed
    now = read_stored(tmp_path / "now").results
    assert {one.name for _, one in now} <= {one.name for one in results}
    page = ET.parse(tmp_path / "now" / "index.html")  # noqa: S314 our own
    assert page.getroot().tag == "html"


def test_a_campaign_that_fails_ends_with_status_one(
    spec_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a controller that takes its own time."""
    monkeypatch.setattr(pair, "controller_settings_of", lambda law, _: controller_settings_of(law))
    drop = 'cases=[{kind="drop", messages=["LATERAL_ERROR"], magnitudes=[1.0]}]'
    few = ["--set", "ftti_ms=40", "--set", drop, "--set", "node_cases=[]", "--workers", "1"]
    one_point = ["--set", 'points=[{name="nominal"}]', "--out", str(tmp_path)]
    assert main([str(spec_file), *few, *one_point]) == FAILED


def test_mistakes_are_reported_in_one_line(
    spec_file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mistakes = [
        ["--set", 'laws=["none"]'],
        ["--set", "motion_s=1.2"],
        ["--set", 'cases=[{kind="drop", messages=["HORN"], magnitudes=[1]}]'],
    ]
    for mistake in mistakes:
        assert main([str(spec_file), *mistake, "--out", str(tmp_path / "out")]) == 2
        assert len(capsys.readouterr().err.splitlines()) == 1


@pytest.mark.parametrize("value", ["0", "-1", "2.5", "many", "9" * 5000])
def test_a_number_that_is_none_is_reported_with_its_range(
    value: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match="2"):
        main([f"--workers={value}"])
    assert "argument --workers: allowed is 1 to " in capsys.readouterr().err.splitlines()[-1]


def test_results_of_programs_that_have_changed_are_none_of_these(
    spec: CampaignSettings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "step.py").write_text("GAIN = 1.0")
    monkeypatch.setattr(
        "steer_by_wire.tools.faults.campaign.execution.files", lambda _package: tmp_path
    )
    before = specification_hash(spec)
    assert specification_hash(spec) == before
    (tmp_path / "step.py").write_text("GAIN = 2.0")
    assert specification_hash(spec) != before


def test_results_on_waypoints_that_have_changed_are_none_of_these(tmp_path: Path) -> None:
    road = tmp_path / "road.csv"
    spec = load_settings(
        CampaignSettings,
        overrides=[f'points=[{{name="road",path={{kind="waypoints",file="{road}"}}}}]'],
    )
    road.write_text("x_m,y_m\n0,0\n9,0\n")
    before = specification_hash(spec)
    assert specification_hash(spec) == before
    road.write_text("x_m,y_m\n0,0\n9,1\n")
    assert specification_hash(spec) != before


def test_a_node_that_does_not_look_at_counters_fails_the_campaign(
    monkeypatch: pytest.MonkeyPatch, spec: CampaignSettings
) -> None:
    scenario = next(one for one in scenarios_of(spec) if one.case.kind == "replay")
    assert run_trial(scenario).verdict is Detection.FOLLOWED

    def accept_any(
        check: CounterCheck, counter: int, now_ns: int, content: object
    ) -> CounterResult:
        return check._start(counter, now_ns, content)

    monkeypatch.setattr(CounterCheck, "check", accept_any)
    assert run_trial(scenario).verdict is Detection.MISSED
