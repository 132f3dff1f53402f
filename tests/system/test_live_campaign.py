"""The live campaign: how it judges runs, what it writes of them, and that it covers every fault."""

import sys
from pathlib import Path
from types import MappingProxyType
from typing import Any

import pytest

from steer_by_wire.closed_loop.pair.pair_result import CONTROLLER_PROGRAM, PLANT_PROGRAM
from steer_by_wire.dbc.messages import (
    ControllerFault,
    ControllerSafety,
    Freshness,
    LateralError,
    Mode,
    PlantStatus,
    SafetyState,
    SteeringCommand,
    SteeringStatus,
    SteeringStatusCode,
    encode,
)
from steer_by_wire.plant_emulator.faults.settings import FaultKind
from steer_by_wire.runtime.frame import FD, Frame
from steer_by_wire.runtime.node import NS_PER_S
from steer_by_wire.tools.faults import program as fault_campaign
from steer_by_wire.tools.faults.injection.live_faults import LiveKind, parse_fault
from steer_by_wire.tools.faults.live.cases import LiveCase, live_cases
from steer_by_wire.tools.faults.live.judgement import (
    LiveResult,
    Reaction,
    Vehicle,
    _first_sign,
    counts_of,
    judge_trial,
    mistakes_of,
    vehicle_of,
)
from steer_by_wire.tools.faults.live.live_campaign import (
    live_finding,
    live_section,
    outcome_table,
    record_of,
)
from steer_by_wire.tools.faults.live.live_trial import (
    INJECTOR,
    Trial,
    plant_settings,
    write_excerpt,
    write_key,
)
from steer_by_wire.tools.faults.live.recorded_pair import LiveRun

HELD: dict[str, Any] = {"holdings": 0, "interventions": {}}
PLANT_NODE: dict[str, Any] = {
    "rejected": {},
    "lost_on_the_bus": 0,
    "skipped_samples": 0,
    "safety": HELD,
}
CONTROLLER_NODE: dict[str, Any] = {"rejected": {}, "holds": 0, "lost": 0, "skipped_ticks": 0}


def report_of(node: Any, error_frames: Any = None) -> dict[str, Any]:
    return {"node": node, "connection": {"error_frames": error_frames or {}}}


ACTIONS = ({"time_ns": 1, "fault": "spoof", "what": "begins"},)


def trial_of(
    name: str,
    actions: Any = ACTIONS,
    observed: tuple[int, int] = (0, 10),
    reports: Any = MappingProxyType({}),
    **changes: Any,
) -> Trial:
    case = next(one for one in live_cases() if one.name == name)
    reports = {**reports, INJECTOR: {"actions": actions}}
    run = LiveRun(Path(), {PLANT_PROGRAM: 0, CONTROLLER_PROGRAM: 0}, reports)
    return Trial(case, run._replace(**changes), observed)


def test_a_run_passes_when_each_that_must_has_noticed_the_fault() -> None:
    trial = trial_of("bit flips")
    noticed = {PLANT_PROGRAM: {"bad_crc": 3}, CONTROLLER_PROGRAM: {"bad_crc": 1, "repeated": 2}}
    assert list(mistakes_of(trial, noticed)) == []
    other = {PLANT_PROGRAM: {"bad_crc": 3}, CONTROLLER_PROGRAM: {"repeated": 2}}
    assert list(mistakes_of(trial, other)) == [f"{CONTROLLER_PROGRAM} has not noticed it"]
    idle = trial_of("bit flips", actions=[])
    assert list(mistakes_of(idle, noticed)) == ["the injector did nothing"]
    left = trial_of("bit flips", left=["process plant_emulator"])
    assert list(mistakes_of(left, noticed)) == ["left behind: process plant_emulator"]
    cut = trial_of("bit flips", cut_off="No space left on device")
    (mistake,) = mistakes_of(cut, noticed)
    assert mistake == "the recording of the bus was cut off: No space left on device"
    failed = trial_of("bit flips", statuses={PLANT_PROGRAM: 5})
    assert list(mistakes_of(failed, noticed)) == [f"{PLANT_PROGRAM} has ended with status 5"]


def test_only_who_was_killed_may_end_so_and_a_golden_run_counts_nothing() -> None:
    killed = trial_of("plant killed", statuses={PLANT_PROGRAM: -9, CONTROLLER_PROGRAM: 0})
    noticed = {CONTROLLER_PROGRAM: {"silence": 1}}
    assert list(mistakes_of(killed, noticed)) == []
    assert list(mistakes_of(trial_of("plant killed"), noticed))
    golden = trial_of("golden", actions=[])
    assert list(mistakes_of(golden, {PLANT_PROGRAM: {}, CONTROLLER_PROGRAM: {}})) == []
    assert list(mistakes_of(golden, {PLANT_PROGRAM: {"lost": 1}})) == [
        f"{PLANT_PROGRAM} counts {{'lost': 1}}"
    ]
    stalled = {PLANT_PROGRAM: {"skipped": 3}}
    assert list(mistakes_of(golden, stalled)) == [], "by the machine"


@pytest.mark.parametrize("holds", [0, 1])
def test_who_wakes_first_may_hold_and_both_know_what_they_have_missed(holds: int) -> None:
    plant = report_of({**PLANT_NODE, "skipped_samples": 99, "safety": {**HELD, "holdings": 1}})
    controller = report_of({**CONTROLLER_NODE, "skipped_ticks": 99, "holds": holds})
    noticed = {PLANT_PROGRAM: counts_of(plant), CONTROLLER_PROGRAM: counts_of(controller)}
    trial = trial_of("both clocks jump 1 s")
    assert list(mistakes_of(trial, noticed)) == []
    assert list(mistakes_of(trial, {**noticed, CONTROLLER_PROGRAM: {}})), "its timer cannot miss it"
    unseen = {**noticed, PLANT_PROGRAM: {"skipped": 99}}
    assert list(mistakes_of(trial, unseen)) == [f"{PLANT_PROGRAM} has not noticed it"]


def test_a_fault_in_the_plants_settings_must_have_changed_a_frame() -> None:
    noticed = {CONTROLLER_PROGRAM: {"silence": 1}}
    for changed, mistakes in ((7, []), (0, ["the plant's fault stage did nothing"])):
        reports = {PLANT_PROGRAM: {"node": {"faults": [{"changed": changed}]}}}
        trial = trial_of("measurements lost", actions=[], reports=reports)
        assert list(mistakes_of(trial, noticed)) == mistakes


@pytest.mark.parametrize(
    "case", [one for one in live_cases() if one.at_plant], ids=lambda one: one.name
)
def test_a_fault_at_the_plant_is_settings_that_the_plant_takes(case: LiveCase) -> None:
    (fault,) = plant_settings(case).faults
    assert case.at_plant is not None
    assert (fault.kind, fault.onset_s, fault.duration_s) == (case.at_plant.kind, 2.0, 1.0)


def test_counts_are_those_above_zero_and_the_silences() -> None:
    safety = {"holdings": 1, "interventions": {"angle": 0}}
    plant = {**PLANT_NODE, "rejected": {"bad_crc": 0, "repeated": 2}, "safety": safety}
    assert counts_of(report_of(plant)) == {"repeated": 2, "silence": 1}
    assert counts_of(report_of(CONTROLLER_NODE, {"bus_off": 1})) == {"bus_off": 1}
    late = {**CONTROLLER_NODE, "skipped_ticks": 9, "lost": 8, "holds": 1}
    assert counts_of(report_of(late)) == {"silence": 1, "lost": 8, "skipped": 9}
    limited = {**PLANT_NODE, "safety": {"holdings": 0, "interventions": {"angle": 2, "rate": 3}}}
    assert counts_of(report_of(limited)) == {"intervention": 5}
    secured = {**plant, "authentication": {"refused": {"unauthenticated": 4, "replayed": 0}}}
    assert counts_of(report_of(secured)) == {"repeated": 2, "silence": 1, "unauthenticated": 4}


@pytest.mark.skipif(sys.platform == "win32", reason="it has no such permissions")
def test_the_key_of_a_run_is_new_and_for_its_user_alone(tmp_path: Path) -> None:
    for name in ("one", "other"):
        write_key(tmp_path / name)
        assert (tmp_path / name).stat().st_mode & 0o777 == 0o600
    assert (tmp_path / "one").read_text() != (tmp_path / "other").read_text()


def test_an_authenticated_message_shows_a_fault_as_a_classic_one_does() -> None:
    held = encode(SteeringStatus(0.0, 0, SteeringStatusCode.HOLDING), 0)
    secured = Frame(held.can_id, held.data + bytes(12), FD)
    assert _first_sign([(20, secured)], 10, 100) == 10 / NS_PER_S


def test_the_first_sign_of_a_fault_is_found_behind_its_onset() -> None:
    def status(rejected: int, safety: SafetyState = SafetyState.NORMAL) -> Frame:
        return encode(PlantStatus(0.0, 0.0, 0, rejected, safety), 0)

    held = encode(SteeringStatus(0.0, 0, SteeringStatusCode.HOLDING), 0)
    applying = encode(SteeringStatus(0.0, 0, SteeringStatusCode.APPLYING), 0)
    ms = 1_000_000
    frames = [(0, held), (1 * ms, status(4)), (12 * ms, status(4)), (13 * ms, applying)]
    assert _first_sign(frames, 10 * ms, 100 * ms) is None
    assert _first_sign([*frames, (20 * ms, status(5))], 10 * ms, 100 * ms) == 0.01
    assert _first_sign([*frames, (30 * ms, held)], 10 * ms, 100 * ms) == 0.02
    limiting = status(4, SafetyState.LIMITING)
    assert _first_sign([*frames, (25 * ms, limiting)], 10 * ms, 100 * ms) == 0.015
    limited = encode(SteeringStatus(0.0, 0, SteeringStatusCode.LIMITED_BY_SAFETY), 0)
    assert _first_sign([*frames, (22 * ms, limited)], 10 * ms, 100 * ms) == 0.012
    assert _first_sign([*frames, (30 * ms, held)], 10 * ms, 30 * ms) is None
    stop = encode(SteeringCommand(0.0, 0, Mode.SAFE_STOP), 0)
    assert _first_sign([(40 * ms, stop)], 10 * ms, 100 * ms) == 0.03


def test_the_controller_reports_what_it_refuses_misses_and_finds_wrong() -> None:
    fresh, stale, fine = Freshness.FRESH, Freshness.STALE, ControllerFault.NONE
    ms = 1_000_000
    before = ControllerSafety(2, 5, fresh, fresh, fresh, fine)
    signs = [
        before._replace(rejected=3),
        before._replace(lost=6),
        before._replace(lateral_error_freshness=stale),
        before._replace(fault=ControllerFault.OVERRUNS),
    ]
    for after in (before, before._replace(steering_status_freshness=stale), *signs):
        frames = [(1 * ms, encode(before, 0)), (30 * ms, encode(after, 1))]
        assert _first_sign(frames, 10 * ms, 100 * ms) == (0.02 if after in signs else None)


def test_the_vehicle_is_what_the_plant_reported_before_and_after_the_onset() -> None:
    reported = [
        (1, SteeringStatus(0.1, 0, SteeringStatusCode.APPLYING)),
        (5, SteeringStatus(-0.3, 0, SteeringStatusCode.LIMITED)),
        (9, SteeringStatus(0.9, 0, SteeringStatusCode.FALLBACK)),
    ]
    assert vehicle_of(reported, 5, 9) == Vehicle(None, None, 0.3, 0.1, "LIMITED")
    assert vehicle_of([], 5, 9) == Vehicle(None, None, None, None, "none")


def test_an_excerpt_begins_with_the_first_command(tmp_path: Path) -> None:
    lines = ["(1.0) can0 310#00\n", "(2.0) can0 100#01\n", "(3.0) can0 310#02\n"]
    log, excerpt = tmp_path / "bus.log", tmp_path / "excerpt.log"
    log.write_text("".join(lines))
    write_excerpt(log, excerpt)
    assert excerpt.read_text() == "".join(lines[1:])


def test_a_run_is_judged_by_what_each_program_sent_itself(tmp_path: Path) -> None:
    def line(time_s: float, frame: Frame, side: str) -> str:
        return f"({time_s:.6f}) can0 {frame.can_id:03X}#{frame.data.hex().upper()} {side}\n"

    normal = encode(PlantStatus(0.0, 0.0, 0, 0, SafetyState.NORMAL), 0)
    refused = encode(PlantStatus(0.0, 0.0, 0, 3, SafetyState.NORMAL), 1)
    forged = encode(SteeringCommand(0.0, 0, Mode.SAFE_STOP), 9)
    error = encode(LateralError(-0.25, 0.0), 0)
    own = [(100.0, normal), (101.0, error), (101.2, refused)]
    on_bus = [(100.001, normal), (101.0005, forged), (101.001, error), (101.25, refused)]
    (tmp_path / f"{PLANT_PROGRAM}.log").write_text("".join(line(t, one, "T") for t, one in own))
    (tmp_path / f"{CONTROLLER_PROGRAM}.log").write_text(line(101.2, refused, "R"))
    (tmp_path / "candump.log").write_text("".join(line(t, one, "R") for t, one in on_bus))
    plant = report_of({**PLANT_NODE, "rejected": {"out_of_order": 3}})
    controller = report_of(CONTROLLER_NODE)
    trial = trial_of(
        "spoofed, own counter",
        folder=tmp_path,
        reports={PLANT_PROGRAM: plant, CONTROLLER_PROGRAM: controller},
        actions=[{"time_ns": 101 * NS_PER_S, "fault": "spoof", "what": "begins"}],
        observed=(100 * NS_PER_S, 103 * NS_PER_S),
    )
    outcome = judge_trial(trial)
    assert outcome.mistakes == []
    assert outcome.counts == {PLANT_PROGRAM: {"out_of_order": 3}, CONTROLLER_PROGRAM: {}}
    assert list(outcome.reactions[PLANT_PROGRAM]) == pytest.approx([0.2, 0.25])
    # The only command that stops was on the bus, but the controller has not sent it.
    assert outcome.reactions[CONTROLLER_PROGRAM] == Reaction(None, None)
    assert outcome.vehicle.error_peak_m == pytest.approx(0.25)


def test_the_table_and_the_record_hold_every_run() -> None:
    outcome = LiveResult(
        "plant killed",
        {CONTROLLER_PROGRAM: {"silence": 1}},
        {PLANT_PROGRAM: Reaction(None, None), CONTROLLER_PROGRAM: Reaction(0.137, 0.138)},
        Vehicle(0.1, 0.02, 0.3, 0.1, "APPLYING"),
        {PLANT_PROGRAM: -9, CONTROLLER_PROGRAM: 0},
        [],
        ["something"],
    )
    assert outcome_table([outcome, outcome]).row_count == 2
    (table,) = live_section([outcome, outcome]).tables
    assert {len(row) for row in table.rows} == {len(table.headings)}
    finding = live_finding([outcome, outcome._replace(mistakes=[])])
    assert (finding.holds, finding.figure) == (False, "1 of 2 runs; first: plant killed: something")
    assert live_finding([outcome._replace(mistakes=[])]).holds
    record = record_of(outcome)
    assert record["reactions"][CONTROLLER_PROGRAM] == {"noticed_s": 0.137, "reported_s": 0.138}
    assert record["mistakes"] == ["something"]
    assert set(record["vehicle"]) == set(Vehicle._fields)


def test_every_frame_and_process_fault_is_in_the_live_campaign() -> None:
    kinds = {parse_fault(case.argument, 17).kind for case in live_cases() if case.inject}
    assert kinds == set(LiveKind)


def test_every_fault_of_the_plants_settings_is_live_there_or_on_the_bus() -> None:
    at_plant = {str(case.at_plant.kind) for case in live_cases() if case.at_plant}
    assert at_plant | set(LiveKind) >= set(FaultKind)


def test_the_campaign_runs_the_live_one_too_and_fails_with_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spec = tmp_path / "spec.toml"
    spec.write_text(
        "motion_s = 1.5\nonset_s = 0.5\nfault_s = 0.5\ngolden_seeds = 1\n"
        'laws = ["practical_pd"]\n[[points]]\nname = "nominal"\n[[cases]]\nkind = "duplicate"\n'
        'messages = ["STEERING_COMMAND"]\nmagnitudes = [1.0]\n'
    )
    passed = LiveResult(
        "golden",
        {},
        {PLANT_PROGRAM: Reaction(None, None), CONTROLLER_PROGRAM: Reaction(None, None)},
        Vehicle(0.1, 0.1, 0.1, 0.1, "APPLYING"),
        {PLANT_PROGRAM: 0, CONTROLLER_PROGRAM: 0},
        [],
        [],
    )
    asked: list[Path] = []

    def run_live(folder: Path, _seed: int) -> list[LiveResult]:
        asked.append(folder)
        return [passed._replace(mistakes=["something"] * (len(asked) > 1))]

    monkeypatch.setattr(fault_campaign, "run_live_campaign", run_live)
    words = [str(spec), "--out", str(tmp_path / "out"), "--workers", "1"]
    without = fault_campaign.main(words)
    assert "Live runs" not in (tmp_path / "out" / "index.html").read_text()
    assert fault_campaign.main([*words, "--live"]) == without
    assert asked == [tmp_path / "out" / "live"]
    assert "Live runs" in (tmp_path / "out" / "index.html").read_text()
    assert fault_campaign.main([*words, "--live"]) == fault_campaign.FAILED
    assert "golden: something" in (tmp_path / "out" / "campaign.json").read_text()
