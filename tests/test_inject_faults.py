"""The live injector: what it sends and when is seeded and repeatable; what a live pair makes of it.

The live run asserts what happens, and no time: a shared machine may stall for long.
"""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from itertools import islice, pairwise
from pathlib import Path
from typing import Any

import can
import pytest

from controller.node import ControllerNode
from dbc.messages import (
    CAN_IDS,
    ControllerFault,
    ControllerSafety,
    Decoded,
    Freshness,
    LateralError,
    Mode,
    PlantStatus,
    Rejection,
    SafetyState,
    SteeringCommand,
    SteeringStatus,
    SteeringStatusCode,
    decode,
    encode,
)
from plant_emulator.fault_settings import FaultKind
from plant_emulator.node import PlantNode
from plant_emulator.settings import PlantSettings
from runtime.bus import BusPort
from runtime.bus_model import BusModel
from runtime.emulated_bus.launch import launched_broker
from runtime.frame import ERROR, FD, Frame
from runtime.frame_length import INTERMISSION_BITS, frame_bits
from runtime.node import NEVER_NS, NS_PER_S
from runtime.settings import SettingsError, load_settings
from runtime.virtual_time import VirtualTimeExecutor
from tests.running_program import running, wait_until
from tools import fault_campaign, inject_faults
from tools.campaign.node_faults import NodeFault, with_node_fault
from tools.campaign.scenario import controller_settings_of
from tools.campaign.specification import NodeFaultKind
from tools.campaign_live.cases import CASES, CONTROLLER, PLANT, LiveCase
from tools.campaign_live.judgement import (
    Outcome,
    Telling,
    Vehicle,
    _first_sign,
    counts_of,
    judge_trial,
    mistakes_of,
    vehicle_of,
)
from tools.campaign_live.presentation import (
    live_finding,
    live_section,
    outcome_table,
    record_of,
)
from tools.campaign_live.trial import Trial, plant_settings, write_excerpt, write_key
from tools.live_faults.bus_off import BusOffFault
from tools.live_faults.frames import FRAMES_AT_ONCE, FrameSource, frame_source, recording_of
from tools.live_faults.kinds import (
    FRAME_KINDS,
    MAGNITUDES,
    LiveFault,
    LiveKind,
    list_lines,
    parse_fault,
)

BITRATE_BIT_S = 500_000
START_NS = 7_000_000_000
COMMAND_ID = CAN_IDS[SteeringCommand]


def source_of(text: str, seed: int = 1, recording: Any = ()) -> FrameSource:
    return frame_source(parse_fault(text), START_NS, seed, BITRATE_BIT_S, recording)


def sent(source: FrameSource, step_ns: int = 1_000_000) -> list[tuple[int, Frame]]:
    """Ask a source every ``step_ns`` until it has nothing more."""
    frames = []
    now_ns = START_NS
    while source.next_due_ns != NEVER_NS and now_ns < source.end_ns:
        frames += [(now_ns, frame) for frame in source.due(now_ns)]
        now_ns += step_ns
    return frames


# What is asked for


def test_a_fault_is_its_kind_and_what_is_said_of_it() -> None:
    assert parse_fault("spoof") == LiveFault(LiveKind.SPOOF, 0.0, 1.0, 0.5)
    assert parse_fault("spoof,onset_s=2,magnitude=-0.1,duration_s=3").end_s == 5.0
    assert parse_fault("bit_flips,to=plant").to == "plant"
    assert parse_fault("pause,pid=4711,duration_s=0.5") == LiveFault(
        LiveKind.PAUSE, 0.0, 0.5, 1.0, "both", 4711
    )
    assert parse_fault("kill,onset_s=1", pid=17) == LiveFault(
        LiveKind.KILL, 1.0, 1.0, 1.0, "both", 17
    )
    assert parse_fault("kill,onset_s=1", pid=17).end_s == 1.0


def test_a_clock_jumps_by_its_magnitude_and_a_controller_is_off_for_its_duration() -> None:
    jump = parse_fault("clock_jump,onset_s=1,magnitude=2.5", pid=17)
    assert (jump.magnitude, jump.end_s, jump.pid) == (2.5, 3.5, 17)
    assert parse_fault("bus_off").of == "controller"
    off = parse_fault("bus_off,of=plant,onset_s=1,duration_s=3", pid=17)
    assert (off.of, off.end_s, off.pid) == ("plant", 4.0, 0)


@pytest.mark.parametrize("kind", sorted(FRAME_KINDS))
def test_a_magnitude_is_taken_at_the_ends_of_its_range_and_not_beyond(kind: LiveKind) -> None:
    what, low, high, default, is_whole = MAGNITUDES[kind]
    assert parse_fault(kind).magnitude == default
    step = 1.0 if is_whole else 1e-6
    for good in (low, high):
        assert parse_fault(f"{kind},magnitude={good!r}").magnitude == good
    for bad in (low - step, high + step):
        with pytest.raises(ValueError, match=f"{kind}: magnitude .* must be") as error:
            parse_fault(f"{kind},magnitude={bad!r}")
        assert what in str(error.value)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "'': no such fault; there are babble, "),
        ("jam", "'jam': no such fault"),
        ("spoof,seed=3", "spoof: 'seed=3' is not KEY=VALUE with a key of onset_s, duration_s"),
        ("spoof,onset_s", "spoof: 'onset_s' is not KEY=VALUE"),
        ("spoof,onset_s=1,onset_s=2", "spoof: onset_s is given twice"),
        ("spoof,onset_s=nan", "spoof: onset_s must be 0 to 100000, not 'nan'"),
        ("spoof,onset_s=-1", "spoof: onset_s must be 0 to 100000, not '-1'"),
        ("spoof,duration_s=0", "spoof: duration_s must be 0.001 to 100000, not '0'"),
        ("wrong_length,magnitude=2.5", "wrong_length: magnitude .* must be whole, not 2.5"),
        ("noise,to=plant", "noise: 'to=plant' is not KEY=VALUE"),
        ("bit_flips,to=me", "bit_flips: to must be plant, controller, both, not 'me'"),
        ("kill,duration_s=1,pid=3", "kill: 'duration_s=1' is not KEY=VALUE"),
        ("clock_jump,duration_s=1", "clock_jump: 'duration_s=1' is not KEY=VALUE"),
        ("clock_jump,magnitude=0", "clock_jump: magnitude .* must be 0.001 to 1000, not '0'"),
        ("clock_jump", "clock_jump: needs a process"),
        ("bus_off,of=both", "bus_off: of must be plant or controller, not 'both'"),
        ("bus_off,magnitude=2", "bus_off: 'magnitude=2' is not KEY=VALUE"),
        ("kill", "kill: needs a process, by pid=N here or --pid N, 2 to 4194304"),
        ("pause,pid=1", "pause: needs a process, .*, not '1'"),
        ("pause,pid=-7", "pause: needs a process, .*, not '-7'"),
        ("pause,pid=4194305", "pause: needs a process, .*, not '4194305'"),
        ("pause,pid=²", "pause: needs a process, .*, not '²'"),
    ],
)
def test_a_mistake_in_a_fault_is_one_clear_line(text: str, complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint) as error:
        parse_fault(text)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ([], "give 1 to 100 faults, not 0"),
        (["babble"] * 101, "give 1 to 100 faults, not 101"),
        (["jam"], "no such fault"),
        (["spoof", "--seed", "-1"], "--seed must be 0 to 4294967296, whole, not '-1'"),
        (["kill", "--pid", "1"], "--pid must be 2 to 4194304, whole, not '1'"),
        (["kill", "--pid", "4194304"], "kill: process 4194304: there is none"),
        (["pause", "--pid", str(os.getpid())], "is this program itself"),
        (["replay"], "replay: needs a log, by --recording FILE"),
        (["replay", "--recording", "no.log"], "no.log: No such file or directory"),
        (["bus_off", "-i", "virtual"], "bus_off: only on an emulated bus (-i emulated)"),
    ],
)
def test_a_mistake_on_the_command_line_is_one_clear_line(
    words: list[str],
    complaint: str,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert inject_faults.main(words) == 2
    printed = capsys.readouterr()
    assert complaint in printed.err
    assert printed.err.count("\n") == 1
    assert "ready" not in printed.out


def test_the_list_has_every_kind_with_its_range(capsys: pytest.CaptureFixture[str]) -> None:
    assert inject_faults.main(["--list"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines == list_lines()
    assert [line.split()[0] for line in lines] == list(LiveKind)


# What is sent


@pytest.mark.parametrize("kind", sorted(FRAME_KINDS))
def test_the_same_seed_sends_the_same_frames_at_the_same_times(kind: LiveKind) -> None:
    recording = recording_of([(index * 1_000_000, Frame(index, b"")) for index in range(50)])
    text = f"{kind},onset_s=0.02,duration_s=0.1"
    first, again = (sent(source_of(text, 5, recording)) for _ in range(2))
    assert first == again
    if kind is not LiveKind.SPOOF_NEXT:
        assert first
        assert first[0][0] == START_NS + 20_000_000
        assert first[-1][0] < START_NS + 120_000_000
    if kind in (LiveKind.SPOOF, LiveKind.BIT_FLIPS, LiveKind.NOISE):
        assert sent(source_of(text, 6, recording)) != first


def test_a_spoofed_command_is_a_valid_one_with_a_counter_of_its_own() -> None:
    frames = [decode(frame) for _, frame in sent(source_of("spoof,magnitude=0.3"))]
    assert len(frames) == 100
    counters = []
    for decoded in frames:
        assert isinstance(decoded, Decoded)
        assert isinstance(decoded.message, SteeringCommand)
        assert decoded.message.steer_rad == pytest.approx(0.3)
        counters.append(decoded.counter)
    steps = {(after - before) % 256 for before, after in pairwise(counters)}
    assert steps == {1}


def test_who_listens_forges_the_next_command_and_only_while_it_is_time() -> None:
    source = source_of("spoof_next,onset_s=1,magnitude=-0.2")
    true = encode(SteeringCommand(0.1, 300, Mode.ACTIVE), 255)
    onset_ns = START_NS + NS_PER_S
    assert source.on_frame(true, onset_ns - 1) == ()
    assert source.on_frame(true, onset_ns + NS_PER_S) == ()
    (forged,) = source.on_frame(true, onset_ns)
    decoded = decode(forged)
    assert isinstance(decoded, Decoded)
    assert isinstance(decoded.message, SteeringCommand)
    assert decoded.counter == 0
    assert decoded.message.steer_rad == pytest.approx(-0.2)
    assert source.on_frame(Frame(0x111, true.data), onset_ns) == ()
    assert source.on_frame(true._replace(data=bytes(8)), onset_ns) == ()


@pytest.mark.parametrize(
    ("text", "rejection"),
    [
        ("bit_flips,magnitude=0.001", Rejection.BAD_CRC),
        ("wrong_length,magnitude=7", Rejection.WRONG_LENGTH),
        ("wrong_length,magnitude=0", Rejection.WRONG_LENGTH),
        ("wrong_identifier", Rejection.MASQUERADED),
    ],
)
def test_a_malformed_frame_is_refused_for_what_is_wrong_with_it(
    text: str, rejection: Rejection
) -> None:
    both = [frame for _, frame in sent(source_of(text))]
    assert {decode(frame) for frame in both} == {rejection}
    ids = {frame.can_id for frame in both}
    plant, controller = (
        {frame.can_id for _, frame in sent(source_of(f"{text},to={to}"))}
        for to in ("plant", "controller")
    )
    assert plant == {COMMAND_ID}
    assert ids == plant | controller
    assert not plant & controller


def test_half_of_the_noise_comes_where_somebody_listens() -> None:
    ids = [frame.can_id for _, frame in sent(source_of("noise,magnitude=2000,duration_s=2"))]
    heard = sum(can_id in (COMMAND_ID, CAN_IDS[LateralError]) for can_id in ids)
    assert 0.45 < heard / len(ids) < 0.55
    assert max(ids) > 0x700


def test_a_node_that_babbles_takes_the_share_of_the_bus_it_is_told() -> None:
    frames = [frame for _, frame in sent(source_of("babble,magnitude=0.25"))]
    assert {frame.can_id for frame in frames} == {0}
    bits = sum(frame_bits(frame).nominal + INTERMISSION_BITS for frame in frames)
    assert bits / BITRATE_BIT_S == pytest.approx(0.25, rel=0.1)  # stuff bits differ


def test_a_node_that_babbles_at_full_load_always_has_a_frame_ready() -> None:
    source = source_of("babble")
    assert len(list(source.due(START_NS))) == FRAMES_AT_ONCE
    assert source.next_due_ns <= START_NS
    assert len(list(islice(source.due(START_NS + 1), 3))) == 3
    assert not list(source.due(START_NS + NS_PER_S))


def test_a_recording_is_sent_in_its_order_and_at_its_times() -> None:
    first, second, broken = Frame(1, b"a"), Frame(2, b"b"), Frame(3, b"", ERROR)
    recording = recording_of([(5_000_000_000, second), (2_000_000_000, first), (1, broken)])
    assert recording == [(0, first), (3_000_000_000, second)]
    source = source_of("replay,magnitude=10,onset_s=0.1", recording=recording)
    assert sent(source) == [(START_NS + 100_000_000, first), (START_NS + 400_000_000, second)]
    source = source_of("replay,magnitude=2", recording=recording)
    assert [frame for _, frame in sent(source)] == [first], "the second is beyond the duration"
    assert recording_of([(0, broken)]) == []


# Processes


@pytest.fixture
def sleeper() -> Iterator[subprocess.Popen[bytes]]:
    with subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"]) as process:
        yield process
        process.kill()


def state_of(pid: int) -> str:
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]


@pytest.mark.skipif(sys.platform != "linux", reason="processes are held by descriptors of Linux")
@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_whatever_ends_the_injector_a_paused_process_goes_on(
    end: signal.Signals, sleeper: subprocess.Popen[bytes]
) -> None:
    words = ["pause,duration_s=1000", "--pid", str(sleeper.pid)]
    with subprocess.Popen(
        [sys.executable, "-m", "tools.inject_faults", *words], stdout=subprocess.PIPE, text=True
    ) as injector:
        wait_until(lambda: state_of(sleeper.pid) == "T", "the process stops")
        injector.send_signal(end)
        printed, _ = injector.communicate(timeout=60)
    assert injector.returncode == 0
    assert state_of(sleeper.pid) != "T"
    assert f"SIGSTOP to process {sleeper.pid}" in printed
    assert printed.splitlines()[-1].endswith(f"pause: SIGCONT to process {sleeper.pid}")


@pytest.mark.skipif(sys.platform != "linux", reason="processes are held by descriptors of Linux")
def test_a_killed_process_is_killed_once_and_what_comes_later_is_told(
    sleeper: subprocess.Popen[bytes], capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["kill", "pause,onset_s=0.2,duration_s=0.01", "--pid", str(sleeper.pid)]
    assert inject_faults.main(words) == 0
    printed = capsys.readouterr().out
    assert f"kill: SIGKILL to process {sleeper.pid}" in printed
    assert sleeper.wait(60) == -signal.SIGKILL


# A live pair


def test_a_live_pair_refuses_spoofed_commands_holds_while_the_plant_is_paused_and_sees_bus_off(
    tmp_path: Path,
) -> None:
    with launched_broker(["--allow-bus-off"]) as address:
        bus = ["-i", "emulated", "-c", "can0", "--bus-kwargs", f"address={address}"]
        plant_options = ["--set", "duration_s=600", "--reconnect", *bus]
        with (
            running("plant_emulator", plant_options, tmp_path / "plant.json") as plant,
            running(
                "controller", [*bus, "--preset", "practical_pd"], tmp_path / "controller.json"
            ) as controller,
        ):
            pause = f"pause,onset_s=0.7,duration_s=0.6,pid={plant.pid}"
            off = "bus_off,onset_s=1.5,duration_s=0.2,of=plant"
            words = ["spoof,duration_s=0.5", pause, off]
            report = tmp_path / "injector.json"
            injector = [sys.executable, "-m", "tools.inject_faults", *words, *bus]
            done = subprocess.run(
                [*injector, "--report", str(report)], capture_output=True, text=True, check=True
            )
            plant.wait_for("the bus is back after")
            assert plant.interrupt() == 0
            assert controller.interrupt() == 0
    assert "spoof: begins" in done.stdout
    assert plant.report()["connection"]["error_frames"] == {"bus_off": 1, "restarted": 1}
    assert [line for line in done.stdout.splitlines() if "frames sent" in line]
    # Whether its counter fits or not, some are refused: the spoofed ones, or the true ones.
    assert sum(plant.report()["node"]["rejected"].values()) > 0
    assert controller.report()["node"]["holds"] >= 1


# The live campaign's judgement


PLANT_NODE: dict[str, Any] = {
    "rejected": {},
    "lost_on_the_bus": 0,
    "skipped_samples": 0,
    "safety": {"holdings": 0, "interventions": {}},
}
CONTROLLER_NODE: dict[str, Any] = {"rejected": {}, "holds": 0, "lost": 0, "skipped_ticks": 0}


def report_of(node: Any, error_frames: Any = None) -> dict[str, Any]:
    return {"node": node, "connection": {"error_frames": error_frames or {}}}


def trial_of(name: str, **changes: Any) -> Trial:
    case = next(one for one in CASES if one.name == name)
    statuses = {PLANT: 0, CONTROLLER: 0}
    actions = [{"time_ns": 1, "fault": "spoof", "what": "begins"}]
    return Trial(case, Path(), statuses, {}, actions, (0, 10), [])._replace(**changes)


def test_a_run_passes_when_each_that_must_has_noticed_the_fault() -> None:
    trial = trial_of("bit flips")
    noticed = {PLANT: {"bad_crc": 3}, CONTROLLER: {"bad_crc": 1, "repeated": 2}}
    assert list(mistakes_of(trial, noticed)) == []
    other = {PLANT: {"bad_crc": 3}, CONTROLLER: {"repeated": 2}}
    assert list(mistakes_of(trial, other)) == [f"{CONTROLLER} has not noticed it"]
    assert list(mistakes_of(trial._replace(actions=[]), noticed)) == ["the injector did nothing"]
    left = trial._replace(left=["process plant-emulator"])
    assert list(mistakes_of(left, noticed)) == ["left behind: process plant-emulator"]
    failed = trial._replace(statuses={PLANT: 5})
    assert list(mistakes_of(failed, noticed)) == [f"{PLANT} has ended with status 5"]


def test_only_who_was_killed_may_end_so_and_a_golden_run_counts_nothing() -> None:
    killed = trial_of("plant killed", statuses={PLANT: -9, CONTROLLER: 0})
    noticed = {CONTROLLER: {"silence": 1}}
    assert list(mistakes_of(killed, noticed)) == []
    assert list(mistakes_of(killed._replace(statuses={PLANT: 0}), noticed))
    golden = trial_of("golden", actions=[])
    assert list(mistakes_of(golden, {PLANT: {}, CONTROLLER: {}})) == []
    assert list(mistakes_of(golden, {PLANT: {"lost": 1}})) == [f"{PLANT} counts {{'lost': 1}}"]
    stalled = {PLANT: {"skipped": 3}}
    assert list(mistakes_of(golden, stalled)) == [], "by the machine"


def test_a_program_may_end_by_bus_off_only_where_that_is_expected() -> None:
    noticed = {PLANT: {"silence": 1}, CONTROLLER: {"bus_off": 1}}
    statuses = {PLANT: 0, CONTROLLER: 3}
    given_up = trial_of("controller in bus-off, not kept", statuses=statuses)
    assert list(mistakes_of(given_up, noticed)) == []
    assert list(mistakes_of(given_up._replace(statuses={CONTROLLER: 0}), noticed))
    kept = trial_of("controller in bus-off", statuses=statuses)
    assert list(mistakes_of(kept, noticed)) == [f"{CONTROLLER} has ended with status 3"]


def test_a_fault_in_the_plants_settings_must_have_changed_a_frame() -> None:
    noticed = {CONTROLLER: {"silence": 1}}
    for changed, mistakes in ((7, []), (0, ["the plant's fault stage did nothing"])):
        reports = {PLANT: {"node": {"faults": [{"changed": changed}]}}}
        trial = trial_of("measurements lost", actions=[], reports=reports)
        assert list(mistakes_of(trial, noticed)) == mistakes


@pytest.mark.parametrize("case", [one for one in CASES if one.at_plant], ids=lambda one: one.name)
def test_a_fault_at_the_plant_is_settings_that_the_plant_takes(
    case: LiveCase, tmp_path: Path
) -> None:
    path = tmp_path / "plant.toml"
    path.write_text(plant_settings(case))
    (fault,) = load_settings(PlantSettings, None, path, []).faults
    assert (fault.kind, fault.onset_s, fault.duration_s) == (case.at_plant["kind"], 2.0, 1.0)


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


def test_the_controller_tells_what_it_refuses_misses_and_finds_wrong() -> None:
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


def test_the_vehicle_is_what_the_plant_told_before_and_after_the_onset() -> None:
    told = [
        (1, SteeringStatus(0.1, 0, SteeringStatusCode.APPLYING)),
        (5, SteeringStatus(-0.3, 0, SteeringStatusCode.LIMITED)),
        (9, SteeringStatus(0.9, 0, SteeringStatusCode.FALLBACK)),
    ]
    assert vehicle_of(told, 5, 9) == Vehicle(None, None, 0.3, 0.1, "LIMITED")
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
    (tmp_path / f"{PLANT}.log").write_text("".join(line(t, one, "T") for t, one in own))
    (tmp_path / f"{CONTROLLER}.log").write_text(line(101.2, refused, "R"))
    (tmp_path / "bus.log").write_text("".join(line(t, one, "R") for t, one in on_bus))
    plant = report_of({**PLANT_NODE, "rejected": {"out_of_order": 3}})
    controller = report_of(CONTROLLER_NODE)
    trial = trial_of(
        "spoofed, own counter",
        folder=tmp_path,
        reports={PLANT: plant, CONTROLLER: controller},
        actions=[{"time_ns": 101 * NS_PER_S, "fault": "spoof", "what": "begins"}],
        observed=(100 * NS_PER_S, 103 * NS_PER_S),
    )
    outcome = judge_trial(trial)
    assert outcome.mistakes == []
    assert outcome.counts == {PLANT: {"out_of_order": 3}, CONTROLLER: {}}
    assert list(outcome.tellings[PLANT]) == pytest.approx([0.2, 0.25])
    # The only command that stops was on the bus, but the controller has not sent it.
    assert outcome.tellings[CONTROLLER] == Telling(None, None)
    assert outcome.vehicle.error_peak_m == pytest.approx(0.25)


def test_the_table_and_the_record_hold_every_run() -> None:
    outcome = Outcome(
        "plant killed",
        {CONTROLLER: {"silence": 1}},
        {PLANT: Telling(None, None), CONTROLLER: Telling(0.137, 0.138)},
        Vehicle(0.1, 0.02, 0.3, 0.1, "APPLYING"),
        {PLANT: -9, CONTROLLER: 0},
        [],
        ["something"],
    )
    assert outcome_table([outcome, outcome]).row_count == 2
    (table,) = live_section([outcome, outcome]).tables
    assert {len(row) for row in table.rows} == {len(table.headings)}
    finding = live_finding([outcome, outcome._replace(mistakes=[])])
    assert (finding.holds, finding.figure) == (
        False,
        "1 of 2 runs; first: plant killed: something",
    )
    assert live_finding([outcome._replace(mistakes=[])]).holds
    record = record_of(outcome)
    assert record["tellings"][CONTROLLER] == {"noticed_s": 0.137, "told_s": 0.138}
    assert record["mistakes"] == ["something"]
    assert set(record["vehicle"]) == set(Vehicle._fields)


def test_every_frame_and_process_fault_is_in_the_live_campaign() -> None:
    kinds = {parse_fault(case.argument, 17).kind for case in CASES if case.fault}
    assert kinds == set(LiveKind)


def test_every_fault_of_the_plants_settings_is_live_there_or_on_the_bus() -> None:
    at_plant = {str(case.at_plant["kind"]) for case in CASES if case.at_plant}
    assert at_plant | set(LiveKind) >= set(FaultKind)


# Bus-off and clocks


def test_a_node_is_in_bus_off_from_onset_to_end_or_until_the_injector_goes() -> None:
    fault = parse_fault("bus_off,onset_s=1,duration_s=2,of=controller")
    options = {"interface": "emulated", "channel": "can0"}
    with (
        launched_broker(["--allow-bus-off"]) as address,
        can.Bus(**options, address=address) as node,  # type: ignore[arg-type]
        can.Bus(**options, address=address) as own,  # type: ignore[arg-type]
    ):
        node.send(can.Message(arbitration_id=COMMAND_ID, is_extended_id=False))
        assert own.recv(10.0) is not None
        port = BusPort(own)
        whole, cut, early = (BusOffFault(fault, START_NS, port) for _ in range(3))
        assert whole.next_due_ns == START_NS + NS_PER_S
        assert whole.act(START_NS) == ""
        assert whole.act(START_NS + NS_PER_S) == "bus-off"
        assert whole.next_due_ns == START_NS + 3 * NS_PER_S
        assert whole.act(START_NS + 3 * NS_PER_S) == "restart"
        assert whole.close() == "", "nothing lasts"
        heard = [node.recv(10.0) for _ in range(2)]
        assert [one and one.arbitration_id for one in heard] == [0x40, 0x100]
        assert cut.act(START_NS + NS_PER_S) == "bus-off"
        assert cut.close() == "restart"
        assert early.close() == "", "it has not begun"


def test_a_broker_that_takes_no_bus_off_is_told_before_anything_begins() -> None:
    with (
        launched_broker() as address,
        can.Bus(interface="emulated", channel="can0", address=address) as bus,
        pytest.raises(SettingsError, match="start its broker with --allow-bus-off"),
    ):
        BusOffFault(parse_fault("bus_off"), START_NS, BusPort(bus))


def struck_in_virtual_time(kind: NodeFaultKind, jump_s: float) -> dict[str, Any]:
    """The controller's report after 3 s, struck after 1 s."""
    controller = ControllerNode(controller_settings_of("practical_pd"), 0)
    fault = NodeFault(kind, "controller", 1.0, jump_s, jump_s)
    struck = with_node_fault(controller, "controller", fault)
    plant = PlantNode(PlantSettings(duration_s=60.0), 0)
    VirtualTimeExecutor([plant, struck], BusModel(BITRATE_BIT_S)).run(3 * NS_PER_S)
    return dict(controller.report())


@pytest.mark.parametrize("jump_s", [0.015, 0.1, 0.5])
def test_a_pause_shows_a_node_on_its_own_clock_what_a_jump_does(jump_s: float) -> None:
    jumped = struck_in_virtual_time(NodeFaultKind.CLOCK_JUMP, jump_s)
    paused = struck_in_virtual_time(NodeFaultKind.PAUSED, jump_s)
    assert jumped["skipped_ticks"] == paused["skipped_ticks"] == int(jump_s * 100)
    assert jumped["rejected"] == paused["rejected"] == {}
    # What waited for the paused one is fresh when it goes on; the other one has nothing so young.
    assert (jumped["holds"], paused["holds"]) == (int(jump_s > 0.135), 0)


def test_the_campaign_runs_the_live_one_too_and_fails_with_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    spec = tmp_path / "spec.toml"
    spec.write_text(
        "motion_s = 1.5\nonset_s = 0.5\nfault_s = 0.5\ngolden_seeds = 1\nresidual_frames = 1000\n"
        "memory_s = 0\n"
        'laws = ["practical_pd"]\n[[points]]\nname = "nominal"\n[[cases]]\nkind = "duplicate"\n'
        'messages = ["STEERING_COMMAND"]\nmagnitudes = [1.0]\n'
    )
    passed = Outcome(
        "golden",
        {},
        {PLANT: Telling(None, None), CONTROLLER: Telling(None, None)},
        Vehicle(0.1, 0.1, 0.1, 0.1, "APPLYING"),
        {PLANT: 0, CONTROLLER: 0},
        [],
        [],
    )
    asked: list[Path] = []

    def run_live(folder: Path, _seed: int) -> list[Outcome]:
        asked.append(folder)
        return [passed._replace(mistakes=["something"] * (len(asked) > 1))]

    monkeypatch.setattr(fault_campaign, "run_live_campaign", run_live)
    words = [str(spec), "--out", str(tmp_path / "out"), "--processes", "1"]
    without = fault_campaign.main(words)
    assert "Live runs" not in (tmp_path / "out" / "index.html").read_text()
    assert fault_campaign.main([*words, "--live"]) == without
    assert asked == [tmp_path / "out" / "live"]
    assert "Live runs" in (tmp_path / "out" / "index.html").read_text()
    assert fault_campaign.main([*words, "--live"]) == fault_campaign.FAILED
    assert "golden: something" in (tmp_path / "out" / "campaign.json").read_text()
