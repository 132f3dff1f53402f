"""A campaign with controllers at another rate than 100 Hz, judged by their own periods."""

import pytest

from steer_by_wire.runtime.settings import load_settings
from steer_by_wire.tools.faults.campaign.campaign_file import CampaignSettings
from steer_by_wire.tools.faults.campaign.campaign_runs import Scenario, scenario_sight, scenarios_of
from steer_by_wire.tools.faults.campaign.detectability import (
    Mechanism,
    no_effect_chance,
    period_s_of,
)
from steer_by_wire.tools.faults.campaign.virtual_trial import Detection, run_trial
from tests.support.suite.combinations import sampled

FAST = "paper_pd"
"""At 1 kHz, on sensors at 100 Hz."""
SHORT = ("motion_s=2.0", "onset_s=0.6", "fault_s=0.5", "golden_seeds=1", f'laws=["{FAST}"]')


def scenario_of(kind: str, message: str, magnitude: float) -> Scenario:
    case = f'cases=[{{kind="{kind}", messages=["{message}"], magnitudes=[{magnitude}]}}]'
    return list(scenarios_of(load_settings(CampaignSettings, None, None, [*SHORT, case])))[-1]


@pytest.mark.parametrize(
    ("message", "period_s"),
    [
        ("STEERING_COMMAND", 0.001),
        ("LATERAL_ERROR", 0.01),
        ("STEERING_STATUS", 0.01),
        ("VEHICLE_STATE", 0.02),
        ("CONTROLLER_STATUS", 0.1),
        ("PLANT_STATUS", 0.1),
    ],
)
def test_a_fault_acts_at_the_rate_of_its_message(message: str, period_s: float) -> None:
    scenario = scenario_of("drop", message, 0.01)
    sight = scenario_sight(scenario.spec, scenario.point, FAST)
    fault = scenario.case.faults[0]
    assert period_s_of(fault, sight) == period_s
    assert no_effect_chance(fault, sight) == pytest.approx(0.99 ** (0.5 / period_s))


def test_the_onset_is_drawn_within_a_control_period() -> None:
    magnitudes = ", ".join(f"{0.01 * n:.2f}" for n in range(1, 30))
    case = f'cases=[{{kind="drop", messages=["LATERAL_ERROR"], magnitudes=[{magnitudes}]}}]'
    spec = load_settings(CampaignSettings, None, None, [*SHORT, case])
    onsets_s = [one.case.faults[0].onset_s for one in scenarios_of(spec) if one.case.faults]
    assert 0.6005 < max(onsets_s) <= 0.601


SHORT_AND_LONG = [  # 20 commands are 20 ms and no silence; 200 are.
    ("burst_loss", "STEERING_COMMAND", 20, Mechanism.E2E, False),
    ("burst_loss", "STEERING_COMMAND", 200, Mechanism.FRESHNESS, True),
]
AGES = [
    # Counters turn over in 256 ms: 0.22 s ago is 36 ahead, which is believed, and 0.2 s ago is
    # 56 ahead. Those of 0.1 s ago have caught up before there is a silence, others have not.
    ("replay", "STEERING_COMMAND", 0.22, Mechanism.E2E, False),
    ("replay", "STEERING_COMMAND", 0.2, Mechanism.E2E, True),
    ("replay", "STEERING_COMMAND", 0.1, Mechanism.E2E, False),
    ("replay", "STEERING_COMMAND", 0.154, Mechanism.E2E, True),
]
SLOW = ("burst_loss", "LATERAL_ERROR", 20, Mechanism.FRESHNESS, True)


@pytest.mark.parametrize(
    ("kind", "message", "magnitude", "mechanism", "leaves"),
    sampled([*SHORT_AND_LONG, *AGES[:2]], [*SHORT_AND_LONG, *AGES, SLOW]),
)
def test_what_a_fast_controllers_peer_sees_is_what_was_expected(
    kind: str, message: str, magnitude: float, mechanism: Mechanism, leaves: bool
) -> None:
    scenario = scenario_of(kind, message, magnitude)
    assert mechanism in scenario.case.expected.mechanisms
    assert scenario.case.expected.safe_state is leaves
    assert run_trial(scenario).verdict in (Detection.PASSED, Detection.FOLLOWED)


def test_a_clock_that_jumps_by_some_fast_periods_is_seen() -> None:
    jump = 'node_cases=[{kind="clock_jump", nodes=["controller"], magnitudes=[0.005]}]'
    spec = load_settings(CampaignSettings, None, None, [*SHORT, jump])
    scenario = list(scenarios_of(spec))[-1]
    assert scenario.case.expected.mechanisms == (Mechanism.SELF_SUPERVISION,)
    assert run_trial(scenario).verdict is Detection.PASSED


def test_a_message_that_nobody_receives_may_hold_up_commands_and_no_more() -> None:
    """At 1 kHz the wire is still busy with PLANT_STATUS when the next command is due."""
    scenario = scenario_of("drop", "PLANT_STATUS", 1.0)
    assert run_trial(scenario).verdict is Detection.NOT_DETECTABLE
