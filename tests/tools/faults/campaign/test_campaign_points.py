"""Operating points and the fault tolerant time of a campaign: what both nodes make of them."""

from importlib.resources import files

import pytest

from steer_by_wire.dbc.messages import Decoded, Mode, SteeringPlan, decode, encode
from steer_by_wire.plant_emulator.faults.messages_on_bus import OURS
from steer_by_wire.runtime.settings import Preset, load_settings
from steer_by_wire.tools.faults.campaign.campaign_file import CampaignSettings
from steer_by_wire.tools.faults.campaign.campaign_runs import (
    Scenario,
    golden_case,
    laws_of,
    scenario_sight,
    scenarios_of,
)
from steer_by_wire.tools.faults.campaign.detectability import Mechanism, no_effect_chance
from steer_by_wire.tools.faults.campaign.virtual_trial import Detection, run_trial
from steer_by_wire.tools.faults.campaign.watched_pair import make_pair, run_pair
from tests.support.suite.combinations import sampled

SHORT = ("motion_s=2.0", "onset_s=0.6", "fault_s=0.5", "golden_seeds=1")
DROPS = 'cases=[{kind="drop", messages=["LATERAL_ERROR", "STEERING_COMMAND"], magnitudes=[1]}]'
ROAD = "60 km/h on a bend, 30 ms"


def spec_of(*overrides: str) -> CampaignSettings:
    return load_settings(CampaignSettings, None, None, [*SHORT, *overrides])


def shipped(*overrides: str) -> CampaignSettings:
    text = files("steer_by_wire.tools.faults").joinpath("default.toml").read_text(encoding="utf-8")
    return load_settings(CampaignSettings, Preset("default", text), None, overrides)


@pytest.mark.parametrize("ftti_ms", [60.0, 200.0])
def test_both_nodes_act_within_the_campaigns_fault_tolerant_time_and_not_long_before(
    ftti_ms: float,
) -> None:
    spec = spec_of(f"ftti_ms={ftti_ms}", DROPS)
    faulty = [one for one in scenarios_of(spec) if one.case.faults]
    assert scenario_sight(spec, spec.points[0], spec.laws[0]).age_limit_s == (ftti_ms - 10.0) * 1e-3
    for result in map(run_trial, faulty):
        assert result.verdict is Detection.PASSED
        assert result.fhti_s is not None
        assert ftti_ms * 1e-3 - 0.03 < result.fhti_s <= ftti_ms * 1e-3


def test_what_the_age_limit_makes_of_a_fault_depends_on_the_fault_tolerant_time() -> None:
    spike = 'cases=[{kind="delay_spike", messages=["LATERAL_ERROR"], magnitudes=[0.12]}]'
    for ftti_ms, mechanisms in ((100.0, (Mechanism.FRESHNESS,)), (150.0, ())):
        scenario = list(scenarios_of(spec_of(f"ftti_ms={ftti_ms}", spike)))[-1]
        assert scenario.case.expected.mechanisms == mechanisms


FAULTS = (
    *('kind="bit_flips", magnitudes=[0.02]', 'kind="replay", magnitudes=[0.2]'),
    *('kind="stuck", magnitudes=[1]', 'kind="drop", magnitudes=[1]'),
    *('kind="freeze", magnitudes=[1]', 'kind="wrong_identifier", magnitudes=[1]'),
    'kind="spoof", magnitudes=[0.05]',
)


@pytest.mark.parametrize("case", sampled(FAULTS[:3], FAULTS))
def test_a_fault_of_a_plan_is_judged_as_that_of_a_command(case: str) -> None:
    """A law that plans sends no commands, and a fault of these is left out."""
    both = f'cases=[{{{case}, messages=["STEERING_COMMAND", "STEERING_PLAN"]}}]'
    spec = spec_of("motion_s=3.0", 'laws=["practical_packet"]', both)
    (scenario,) = [one for one in scenarios_of(spec) if one.case.faults]
    result = run_trial(scenario)
    assert result.where == "STEERING_PLAN"
    assert sum(result.changed) > 20
    expected = {"stuck": Detection.NOT_DETECTABLE, "replay": Detection.FOLLOWED}
    assert result.verdict is expected.get(result.kind, Detection.PASSED)


def test_a_fault_of_a_whole_plan_changes_each_of_its_angles() -> None:
    plan = SteeringPlan(7, Mode.ACTIVE, 40, 5, *(0.001 * place for place in range(18)))
    changed = OURS.with_value(encode(plan, 3), "steer_rad", lambda _name, value: value + 0.1)
    assert changed is not None
    decoded = decode(changed)
    assert isinstance(decoded, Decoded)
    assert decoded.message[4:] == pytest.approx([0.1 + value for value in plan[4:]], abs=1e-5)
    assert decoded.message[:4] == plan[:4]


def test_the_shipped_point_at_road_speed_counts_nothing_without_a_fault() -> None:
    spec = shipped("motion_s=4.0")
    point = next(one for one in spec.points if one.name == ROAD)
    for law in laws_of(spec, point):
        assert law.startswith("highway_")
        pair = make_pair(Scenario(golden_case(), point, law, 1, spec))
        run_pair(Scenario(golden_case(), point, law, 1, spec), pair)
        assert pair.plant.counted() == pair.controller.counted() == {}
        bend = max(abs(sample.wheel_angle_rad) for sample in pair.plant_node.samples)
        assert 0.5 < bend / pair.sight.limiter_rad < 1.0


def test_at_road_speed_the_limits_of_acceleration_and_jerk_act() -> None:
    spec = shipped("motion_s=3.0", "onset_s=1.0", "fault_s=0.5")
    offsets = [
        one for one in scenarios_of(spec) if (one.case.kind, one.case.magnitude) == ("offset", 0.1)
    ]
    commands = [one for one in offsets if one.case.where == "STEERING_COMMAND"]
    by_limiter = [one for one in commands if one.case.expected.mechanisms == (Mechanism.LIMITER,)]
    assert {one.point.name for one in by_limiter} == {ROAD}
    assert len(commands) > len(by_limiter) == 2
    pair = make_pair(by_limiter[0])
    run_pair(by_limiter[0], pair)
    causes = pair.plant_node.report()["safety"]["interventions"]
    assert {"lateral_acceleration", "lateral_jerk"} & causes.keys()


def test_a_fault_whose_chance_to_do_nothing_is_known_may_do_nothing() -> None:
    def chance(kind: str, magnitude: float, message: str = "LATERAL_ERROR") -> float:
        case = f'cases=[{{kind="{kind}", messages=["{message}"], magnitudes=[{magnitude}]}}]'
        spec = spec_of(case)
        scenario = list(scenarios_of(spec))[-1]
        sight = scenario_sight(spec, scenario.point, scenario.law)
        expected = no_effect_chance(scenario.case.faults[0], sight)
        assert scenario.case.expected.may_be_idle == (expected > 1e-4)
        return expected

    assert chance("burst_loss", 3) == pytest.approx(0.95**50)
    assert chance("drop", 0.1) == pytest.approx(0.9**50)
    assert chance("drop", 1.0) == chance("freeze", 1.0) == chance("spoof", 0.1) == 0.0
    assert chance("bit_flips", 0.002) == pytest.approx(0.998 ** (64 * 50))
    assert chance("offset", 0.0) == chance("scale", 1.0) == 1.0
    assert chance("scale", -1.0) == chance("offset", 0.1) == chance("wrong_length", 7) == 0.0
    assert chance("stuck", 1.0, "VEHICLE_STATE") == 1.0
