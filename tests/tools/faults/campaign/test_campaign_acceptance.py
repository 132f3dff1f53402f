"""The campaign can fail: for broken programs, for runs that show nothing, for false frames."""

from typing import Any

import pytest

from steer_by_wire.closed_loop.reports.findings import Finding, finding_lines
from steer_by_wire.controller.node.law_runner import LawRunner
from steer_by_wire.controller.node.newest_messages import Received
from steer_by_wire.dbc.codec.counter_check import CounterCheck
from steer_by_wire.dbc.codec.counter_rule import CounterResult
from steer_by_wire.dbc.messages import Rejection
from steer_by_wire.dbc.reception import Reception
from steer_by_wire.plant_emulator.faults.stage import FaultyNode
from steer_by_wire.plant_emulator.steering import control_unit
from steer_by_wire.plant_emulator.steering.hold_and_fallback import GuardMode, guard_command
from steer_by_wire.runtime.settings import load_settings
from steer_by_wire.tools.faults.campaign import watched_pair as pair_module
from steer_by_wire.tools.faults.campaign.acceptance import findings_of
from steer_by_wire.tools.faults.campaign.campaign_file import CampaignSettings
from steer_by_wire.tools.faults.campaign.campaign_runs import controller_settings_of, scenarios_of
from steer_by_wire.tools.faults.campaign.case_groups import group
from steer_by_wire.tools.faults.campaign.presentation import table_lines
from steer_by_wire.tools.faults.campaign.virtual_trial import (
    FAILURES,
    Detection,
    RunResult,
    run_trial,
)
from steer_by_wire.tools.faults.program import _status

BASE = ("motion_s=2.0", "onset_s=0.6", "fault_s=0.5", "golden_seeds=1", 'laws=["practical_pd"]')
DETECTED, LEFT, REFUSED, EFFECT, RECOVERED, SMOOTH, GOLDEN, VALID, PROTECTED, QUEUES, UNRECEIVED = (
    range(11)
)


def spec_of(*overrides: str) -> CampaignSettings:
    return load_settings(CampaignSettings, None, None, [*BASE, *overrides])


def case(kind: str, message: str, magnitude: float) -> str:
    return f'cases=[{{kind="{kind}", messages=["{message}"], magnitudes=[{magnitude}]}}]'


def faulty(*overrides: str) -> RunResult:
    """The last run of a campaign, which is the one of its only case."""
    return run_trial(list(scenarios_of(spec_of(*overrides)))[-1])


def finding(result: RunResult, place: int) -> Finding:
    return findings_of([result], 150.0)[place]


def test_a_sound_pair_comes_back_in_time_and_without_a_step() -> None:
    for message in ("LATERAL_ERROR", "STEERING_COMMAND"):
        result = faulty(case("drop", message, 1.0))
        assert result.verdict is Detection.PASSED
        assert result.recovery_s is not None
        assert 0.0 < result.recovery_s <= (result.recovery_allowed_s or 0.0) == 0.27
        assert finding(result, RECOVERED).holds
        assert finding(result, SMOOTH).holds


def test_a_controller_that_never_recovers_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    sound = controller_settings_of

    def never(law: str, ftti_ms: float) -> Any:
        settings = sound(law, ftti_ms)
        table = settings.supervision.model_copy(update={"recovery_frames": 10**9})
        return settings.model_copy(update={"supervision": table})

    monkeypatch.setattr(pair_module, "controller_settings_of", never)
    result = faulty(case("drop", "LATERAL_ERROR", 1.0))
    assert result.verdict is Detection.NOT_RECOVERED
    assert finding(result, RECOVERED).holds is False


def test_one_that_recovers_too_late_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    sound = controller_settings_of

    def slow(law: str, ftti_ms: float) -> Any:
        settings = sound(law, ftti_ms)
        table = settings.supervision.model_copy(update={"recovery_frames": 40})
        return settings.model_copy(update={"supervision": table})

    monkeypatch.setattr(pair_module, "controller_settings_of", slow)
    result = faulty(case("drop", "LATERAL_ERROR", 1.0))
    assert result.recovery_s is not None
    assert result.recovery_s > 0.27
    assert result.verdict is Detection.NOT_RECOVERED


def test_an_injector_that_does_nothing_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    def harmless(node: Any, faults: Any, seed: int) -> Any:
        late = tuple(one.model_copy(update={"onset_s": 900.0}) for one in faults)
        return FaultyNode(node, late, seed)

    monkeypatch.setattr(pair_module, "FaultyNode", harmless)
    result = faulty(case("offset", "LATERAL_ERROR", 0.1))
    assert result.verdict is Detection.NO_EFFECT
    assert finding(result, EFFECT).holds is False


def test_a_burst_that_never_begins_is_reported_and_no_failure() -> None:
    """One frame in twenty begins one: in 20 ms it may well not come, which is known before."""
    for seed in range(20):
        result = faulty(case("burst_loss", "LATERAL_ERROR", 3), "fault_s=0.02", f"seed={seed}")
        if not any(result.changed):
            break
    assert result.verdict is Detection.NO_CHANCE
    assert result.verdict not in FAILURES
    assert finding(result, EFFECT).holds
    assert "1 by chance without (burst_loss 3 LATERAL_ERROR)" in finding(result, EFFECT).figure


def test_a_controller_that_jumps_on_its_return_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    run = LawRunner.run

    def jumping(
        law: LawRunner, received: Received, sent_rad: float, period: int, now_ns: int
    ) -> float | None:
        law._fade_rad, law._continues_hold = 0.0, False
        return run(law, received, sent_rad, period, now_ns)

    monkeypatch.setattr(LawRunner, "run", jumping)
    result = faulty(case("drop", "LATERAL_ERROR", 1.0))
    assert result.verdict is Detection.JUMPED
    assert finding(result, SMOOTH).holds is False


def test_a_steering_that_jumps_on_its_return_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    def jumping(p: Any, x: Any, steer_rad: float, time_ns: int, is_new: bool) -> Any:
        state, is_followed = guard_command(p, x, steer_rad, time_ns, is_new)
        if is_followed and x.mode in (GuardMode.HOLDING, GuardMode.FALLBACK):
            limiter = state.limiter._replace(steer_rad=steer_rad)
            state = state._replace(limiter=limiter, fade_rad=0.0)
        return state, is_followed

    monkeypatch.setattr(control_unit, "guard_command", jumping)
    result = faulty(case("drop", "STEERING_COMMAND", 1.0))
    assert result.verdict is Detection.JUMPED
    assert result.jumps.startswith("wheel by ")


def test_frozen_frames_that_are_accepted_fail(monkeypatch: pytest.MonkeyPatch) -> None:
    """Repetitions counted and yet believed: detected at once, and steered by all the same."""
    take = Reception.take

    def believing(reception: Reception, frame: Any, now_ns: int) -> Any:
        taken = take(reception, frame, now_ns)
        if taken is CounterResult.REPEATED:
            reception.accepted += 1
        return taken

    monkeypatch.setattr(Reception, "take", believing)
    result = faulty(case("freeze", "STEERING_STATUS", 1.0))
    assert result.verdict is Detection.BELIEVED
    assert (result.false_accepted, result.false_frames) == (50, 50)
    assert finding(result, REFUSED).holds is False


def test_of_forged_commands_the_first_is_followed_and_the_share_is_reported() -> None:
    result = faulty(case("spoof", "STEERING_COMMAND", 0.05))
    assert result.verdict is Detection.PASSED
    assert (result.false_frames, result.false_accepted, result.false_after) == (50, 1, 0)
    assert " 2 " in table_lines(group([result]))[-1]


@pytest.mark.parametrize("message", ["LATERAL_ERROR", "STEERING_COMMAND"])
def test_a_replayed_recording_is_followed_only_after_control_was_left(message: str) -> None:
    result = faulty(case("replay", message, 0.2))
    assert result.verdict is Detection.FOLLOWED
    assert result.fhti_s is not None
    assert result.fdti_s is not None
    assert result.fdti_s == pytest.approx(0.0, abs=0.002)
    assert 0.12 < result.fhti_s <= 0.15
    assert result.frti_s == result.fhti_s - result.fdti_s
    assert 0 < result.false_accepted < 0.9 * result.false_frames
    assert "1 followed, as was to be expected (replay)" in finding(result, REFUSED).figure


def test_one_that_believes_a_new_start_at_once_does_not_leave_control_for_a_replay(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    check = CounterCheck.check

    def hasty(sequence: CounterCheck, counter: int, now_ns: int, content: object) -> CounterResult:
        sequence._rule = sequence._rule._replace(resync_ns=0)
        return check(sequence, counter, now_ns, content)

    monkeypatch.setattr(CounterCheck, "check", hasty)
    result = faulty(case("replay", "LATERAL_ERROR", 0.5))
    assert result.verdict is Detection.MISSED
    assert finding(result, LEFT).holds is False


def test_what_limits_a_command_is_reported_on_the_bus() -> None:
    result = faulty(case("offset", "STEERING_COMMAND", 1.0))
    assert result.verdict is Detection.FOLLOWED
    assert result.detected_by == "plant.intervention"
    assert result.reported_s is not None
    assert 0.0 <= result.reported_s < 0.02


def test_a_detection_before_the_onset_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    """As of a node that counts something a period after the campaign looks, before the fault."""
    monkeypatch.setattr(pair_module, "onset_ns_of", lambda _case: 500_000_000)
    take = Reception.take

    def suspicious(reception: Reception, frame: Any, now_ns: int) -> Any:
        if now_ns > 600_000_000:
            reception._rejected[Rejection.BAD_CRC.value] = 1
        return take(reception, frame, now_ns)

    monkeypatch.setattr(Reception, "take", suspicious)
    result = faulty(case("bit_flips", "LATERAL_ERROR", 0.5))
    assert result.fdti_s is not None
    assert result.fdti_s < 0.0
    assert result.verdict is Detection.EARLY
    assert finding(result, DETECTED).holds is False
    assert finding(result, GOLDEN).holds is False


def test_nothing_holds_that_no_run_has_shown() -> None:
    golden = run_trial(next(scenarios_of(spec_of())))
    findings = findings_of([golden], 150.0)
    held = [one.holds for one in findings]
    assert [held[place] for place in (DETECTED, EFFECT)] == [False, False]
    asked = (LEFT, REFUSED, RECOVERED, SMOOTH, PROTECTED, UNRECEIVED)
    assert [held[place] for place in asked] == [None] * len(asked)
    assert [held[place] for place in (GOLDEN, VALID, QUEUES)] == [True] * 3
    assert not any(one.holds for one in findings_of([], 150.0))
    assert _status(findings) == 1
    lines = finding_lines(findings)
    assert [line[:3] for line in lines[:2]] == ["NO ", "-  "]


def test_findings_fail_for_what_must_not_be() -> None:
    golden = run_trial(next(scenarios_of(spec_of())))
    fault = golden._replace(kind="drop", expected="E2E", fdti_s=0.15, fhti_s=0.15)
    left = fault._replace(safe_state=True)
    came = fault._replace(recovery_allowed_s=0.2, recovery_s=0.2)
    stepped = fault._replace(wheel_return_rad=0.1)
    corrupted = golden._replace(corrupted=1000, corrupted_accepted=1)
    unreceived = golden._replace(as_golden=True)
    cases = [
        (DETECTED, fault, fault._replace(fdti_s=0.1501)),
        (DETECTED, fault, fault._replace(fdti_s=None, verdict=Detection.MISSED)),
        (LEFT, left, left._replace(fhti_s=0.1501)),
        (LEFT, left, left._replace(fhti_s=None)),
        (RECOVERED, came, came._replace(recovery_s=0.201)),
        (RECOVERED, came, came._replace(recovery_s=None)),
        (SMOOTH, stepped, stepped._replace(jumps="wheel")),
        (GOLDEN, golden, golden._replace(verdict=Detection.FALSE_ALARM)),
        (VALID, golden, golden._replace(verdict=Detection.UNSAFE, unsafe="command of 2 rad")),
        (PROTECTED, corrupted, corrupted._replace(corrupted_accepted=3)),
        (QUEUES, golden, golden._replace(bus_refused=1)),
        (UNRECEIVED, unreceived, unreceived._replace(verdict=Detection.DISTURBED)),
    ]
    for place, right, wrong in cases:
        assert finding(right, place).holds is True, place
        assert finding(wrong, place).holds is False, place
