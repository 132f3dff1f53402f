"""The benchmark on a bus: its programs, its arithmetic and its result; never its figures."""

import array
import gc
import json
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import pytest

from benchmarks.bus import benchmark, runs, watched_controller
from benchmarks.bus.allocations import TickMemory, tick_memory
from benchmarks.bus.lines import answer_lines, memory_lines, parts, skipped_lines, tick_lines
from benchmarks.bus.processes import CompileError, CPrograms, Role, compile_all, started
from benchmarks.bus.records import (
    Answers,
    Passage,
    Skipped,
    Tick,
    answers,
    lateness,
    read_passages,
    read_ticks,
    skipped,
)
from benchmarks.bus.runs import (
    BARE_PYTHON,
    C_ECHO,
    NODE,
    PRESET,
    PYTHON_WITH_TIMEOUT,
    REPLY_ID,
    REQUEST_ID,
    AnswerRun,
    Bench,
    TickRun,
    answer_run,
    socketcan_options,
    tick_run,
    write_frames,
)
from benchmarks.bus.watched_controller import WARM_UP_TICKS, AtOnce, AtRate
from benchmarks.measurement import Line
from steer_by_wire.closed_loop.processes.process_group import ProcessError
from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc.messages import CAN_IDS, LateralError, SteeringCommand, encode
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.node import NEVER_NS
from steer_by_wire.runtime.node.statistics import DurationSummary

MS = 1_000_000
needs_gcc = pytest.mark.skipif(
    sys.platform != "linux" or shutil.which("gcc") is None, reason="needs gcc on Linux"
)


@pytest.fixture(scope="module")
def programs(tmp_path_factory: pytest.TempPathFactory) -> CPrograms:
    return compile_all(tmp_path_factory.mktemp("programs"))


def main(words: Sequence[str]) -> int:
    """Run the program. Its other benchmarks import what User Mode Linux takes long for."""
    from benchmarks.__main__ import main as program

    return program(words)


def controller() -> ControllerNode:
    return ControllerNode(controller_preset(PRESET), 0)


def measurement(counter: int) -> Frame:
    return encode(LateralError(0.01, 0.0), counter % 256)


def own(stamp_ns: int) -> Passage:
    return Passage(stamp_ns, REQUEST_ID, True, b"")


def reply(stamp_ns: int, can_id: int = REPLY_ID) -> Passage:
    return Passage(stamp_ns, can_id, False, b"")


# --- the C programs -----------------------------------------------------------------------------


def test_without_gcc_one_line_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(CompileError, match=r"apt-get install gcc"):
        compile_all(tmp_path)


@needs_gcc
def test_the_c_loop_wakes_up_on_its_grid_and_never_early(
    programs: CPrograms, tmp_path: Path
) -> None:
    log = tmp_path / "log"
    command = [str(programs.timer_loop), str(MS), str(30 * MS), str(log)]
    result = subprocess.run(command, input=b"g", capture_output=True, check=True)
    assert result.stdout == b"ready\n"
    ticks = read_ticks(log)
    assert 1 <= len(ticks) <= 31
    assert all((tick.deadline_ns - ticks[0].deadline_ns) % MS == 0 for tick in ticks)
    assert all(tick.served_ns >= tick.deadline_ns for tick in ticks)
    assert ticks == sorted(set(ticks))


NO_SUCH_CHANNEL = "nosuchcan0"
NOT_THERE = r"Address family not supported|No such device|no network interface nosuchcan0"
"""What the programs say of that channel, when they have read the rest of their command lines."""


class AllStartedError(Exception):
    """Ends a run before its programs begin."""


@needs_gcc
@pytest.mark.parametrize(
    "run",
    [*(partial(answer_run, who=who) for who in benchmark.ANSWERING), tick_run],
    ids=[*benchmark.ANSWERING, "at its rate"],
)
def test_every_program_reads_its_command_line_until_it_misses_the_interface(
    run: Callable[..., object],
    programs: CPrograms,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    roles: list[Role] = []

    @contextmanager
    def noted(role: Role, _folder: Path) -> Iterator[None]:
        roles.append(role)
        if role.name not in ("timer_loop", "requester"):
            raise AllStartedError
        yield

    monkeypatch.setattr(runs, "started", noted)
    options = socketcan_options(NO_SUCH_CHANNEL)
    bench = Bench(NO_SUCH_CHANNEL, options, tmp_path, programs, priority=0)
    write_frames(bench.frames)
    with pytest.raises(AllStartedError):
        run(bench, rate_hz=100, seconds=0.01)
    for role in roles[-2:]:
        if role.name == "controller":  # here: a process would import for a second
            arguments = role.command[role.command.index(watched_controller.__name__) + 1 :]
            assert watched_controller.main(arguments) == ExitStatus.BUS
            assert re.search(NOT_THERE, capsys.readouterr().err)
        else:
            with pytest.raises(ProcessError, match=NOT_THERE), started(role, tmp_path):
                pass


# --- what the logs say --------------------------------------------------------------------------


def test_logs_are_read_as_they_are_written(tmp_path: Path) -> None:
    log = tmp_path / "log"
    log.write_bytes(
        bytes.fromhex("0102000000000000 10010000 01 03 ffff 0a0b0c0000000000")
        + bytes.fromhex("0202000000000000 00010000 00 08 ffff 0102030405060708")
    )
    assert read_passages(log) == [
        Passage(0x201, 0x110, True, b"\x0a\x0b\x0c"),
        Passage(0x202, 0x100, False, bytes(range(1, 9))),
    ]
    log.write_bytes(array.array("q", [5, 7, 15, 16]).tobytes())
    assert read_ticks(log) == [Tick(5, 7), Tick(15, 16)]


def test_an_answer_is_the_first_reply_before_the_next_request() -> None:
    passages = [
        reply(1),
        own(1000),
        reply(1010, can_id=0x300),
        reply(1040),
        reply(1090),
        own(2000),
        own(3000),
        reply(3060),
        own(4000),
    ]
    result = answers(passages, REPLY_ID)
    assert result.durations.samples == 2
    assert (result.durations.p50_ns, result.durations.max_ns) == (40, 60)
    assert result.unanswered == 2


def test_lateness_is_from_the_deadline() -> None:
    summary = lateness([Tick(100, 103), Tick(200, 209)])
    assert (summary.samples, summary.p50_ns, summary.max_ns) == (2, 3, 9)


def test_a_tick_served_in_a_later_period_has_missed_those_before() -> None:
    late = [Tick(0, 99), Tick(100, 310), Tick(400, 500)]
    nobody = Skipped(total=3, own=0)
    assert skipped(late, [], 100) == nobody
    assert skipped(late, [Tick(0, 50), Tick(50, 350)], 100) == nobody


def test_a_missed_period_is_ones_own_where_the_c_loop_woke_up_within_it() -> None:
    late = [Tick(100, 310)]
    assert skipped(late, [Tick(150, 199)], 100) == Skipped(2, own=1)
    assert skipped(late, [Tick(150, 199), Tick(250, 299)], 100) == Skipped(2, own=2)
    assert skipped(late, [Tick(50, 99), Tick(150, 300)], 100) == Skipped(2, own=0)


# --- the watched controller ---------------------------------------------------------------------


def test_at_its_rate_the_watched_controller_sends_what_the_controller_sends() -> None:
    watched, plain = AtRate(controller()), controller()
    for counter in range(50):
        now_ns = plain.deadline_ns
        assert watched.deadline_ns == now_ns
        assert watched.on_frame(measurement(counter), now_ns) == ()
        plain.on_frame(measurement(counter), now_ns)
        assert watched.on_tick(now_ns + 7) == plain.on_tick(now_ns + 7)
    assert list(watched.ticks[:4]) == [0, 7, 10 * MS, 10 * MS + 7]


def test_at_once_each_measurement_is_answered_by_the_command_of_its_tick() -> None:
    watched, plain = AtOnce(controller()), controller()
    for counter in range(300):
        now_ns = plain.deadline_ns
        plain.on_frame(measurement(counter), now_ns)
        sent = watched.on_frame(measurement(counter), 123 + counter)
        assert sent == plain.on_tick(now_ns)
        assert sent[0].can_id == CAN_IDS[SteeringCommand]
        assert watched.on_frame(Frame(0x7F0, b""), 0) == ()
        assert watched.deadline_ns == NEVER_NS


def test_a_collection_of_garbage_in_the_loop_is_counted_and_none_after_it() -> None:
    watched = AtRate(controller())
    for counter in range(WARM_UP_TICKS + 20):
        if counter in (WARM_UP_TICKS // 2, WARM_UP_TICKS + 5, WARM_UP_TICKS + 9):
            gc.collect()
        watched.on_tick(watched.deadline_ns)
    gc.collect()
    report = watched.report()
    assert (report["ticks_watched"], report["collections"]) == (20, 2)
    assert report["skipped_ticks"] == 0


def test_ticks_leave_the_collector_nothing_to_do() -> None:
    memory = tick_memory(PRESET, 1000)
    assert memory.ticks == 1000
    assert memory.collections_if_on == 0
    assert memory.bytes_at_peak > 0


# --- the result ---------------------------------------------------------------------------------


def answered(p50_ns: int, p99_ns: int = 1000, unanswered: int = 0) -> AnswerRun:
    return AnswerRun(Answers(DurationSummary(9, 0.0, p50_ns, p99_ns, p99_ns), unanswered), REPORT)


def ticked(period_ns: int, late_ns: Sequence[int], reference_ns: Sequence[int]) -> TickRun:
    def ticks(lateness_ns: Sequence[int]) -> list[Tick]:
        return [Tick(k * period_ns, k * period_ns + ns) for k, ns in enumerate(lateness_ns)]

    durations = answered(5 * MS).answers
    return TickRun(period_ns, ticks(late_ns), ticks(reference_ns), durations, REPORT)


REPORT = {"node": {"collections": 0, "blocks_kept_per_tick": 0.5}}
ANSWERED = {
    C_ECHO: [answered(10), answered(10), answered(20)],
    BARE_PYTHON: [answered(100), answered(200), answered(400)],
    PYTHON_WITH_TIMEOUT: [answered(100), answered(200), answered(400)],
    NODE: [answered(149), answered(299), answered(4000, unanswered=3)],
}


def by_name(lines: Sequence[Line]) -> Mapping[str, Line]:
    return {line.name: line for line in lines}


def test_a_ratio_is_within_each_repetition_and_its_median_is_judged() -> None:
    lines = by_name(answer_lines(ANSWERED))
    ratio = lines[f"turn-around, {NODE}, to {BARE_PYTHON}, p50"]
    assert ratio.figures == [1.49, 1.495, 10.0]
    assert ratio.is_met
    slower = {**ANSWERED, NODE: [answered(149), answered(301), answered(601)]}
    assert not by_name(answer_lines(slower))[ratio.name].is_met
    assert lines[f"turn-around, {C_ECHO}, p50"].figures == [0.01, 0.01, 0.02]
    assert lines[f"requests unanswered, {NODE}"].figures == [0.0, 0.0, 3.0]


def test_lateness_is_judged_against_twice_that_of_the_c_loop() -> None:
    met = tick_lines([ticked(10 * MS, [20] * 9, [10] * 9)])
    missed = tick_lines([ticked(10 * MS, [21] * 9, [10] * 9)])
    name = "lateness, 100 Hz, controller to C loop, p99"
    assert by_name(met)[name].is_met
    assert not by_name(missed)[name].is_met


def test_only_skipped_ticks_that_the_c_loop_met_are_held_against_the_controller() -> None:
    alike = skipped_lines(ticked(MS, [0, 2 * MS + 9, 0], [0, 2 * MS, 0]))
    assert [line.median for line in alike] == [2.0, 2.0, 0.0]
    assert alike[-1].is_met
    alone = skipped_lines(ticked(MS, [0, 2 * MS + 9, 0], [0, 5, 5]))
    assert [line.median for line in alone] == [2.0, 0.0, 2.0]
    assert not alone[-1].is_met


def test_a_long_run_is_divided_into_equal_parts() -> None:
    run = ticked(MS, list(range(101)), list(range(101)))
    divided = parts(run, 5)
    assert [len(part.ticks) for part in divided] == [20] * 5
    assert divided[1].ticks[0] == Tick(20 * MS, 20 * MS + 20)
    assert divided[1].reference == divided[1].ticks


def test_one_collection_in_the_loop_misses_the_target() -> None:
    memory = TickMemory(1000, 0, 400.0, 1.0)
    none = memory_lines(memory, [REPORT["node"]])
    assert none[0].is_met
    some = memory_lines(memory, [{"collections": 1, "blocks_kept_per_tick": 0.0}])
    assert not some[0].is_met


def test_the_program_says_how_to_come_by_an_interface(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bus", "--channel", "nosuchcan0"]) == 3
    assert "tools/with_vcan" in capsys.readouterr().err


@needs_gcc
def test_the_program_writes_every_line_with_its_target(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    who_answers: list[str] = []

    def fake_answers(_bench: Bench, who: str, _rate_hz: int, _seconds: float) -> AnswerRun:
        who_answers.append(who)
        return answered(100)

    def fake_ticks(_bench: Bench, rate_hz: int, _seconds: float) -> TickRun:
        return ticked(1000 * MS // rate_hz, [10] * 50, [10] * 50)

    monkeypatch.setattr(benchmark, "socketcan_obstacle", lambda _channel: "")
    monkeypatch.setattr(benchmark, "answer_run", fake_answers)
    monkeypatch.setattr(benchmark, "tick_run", fake_ticks)
    monkeypatch.setattr(benchmark, "MEMORY_TICKS", 50)
    out = tmp_path / "out.json"
    assert main(["bus", "--repetitions", "2", "--json", str(out)]) == 0
    content = json.loads(out.read_text(encoding="utf-8"))
    assert who_answers == [C_ECHO, BARE_PYTHON, PYTHON_WITH_TIMEOUT, NODE] * 2
    targets = [line["target"] for line in content["lines"] if line["target"]]
    assert targets == ["≤ 1.5", "≤ 2", "≤ 2", "≤ 0", "≤ 0"]
    assert content["machine"]["python"] in capsys.readouterr().out


@needs_gcc
def test_without_can_lateness_and_skipped_ticks_are_measured(tmp_path: Path) -> None:
    out = tmp_path / "out.json"
    short = ["--duration", "0.2", "--long-duration", "0.2", "--repetitions", "1", "--priority", "0"]
    assert main(["bus", *short, "--no-can", "--json", str(out)]) == 0
    content = json.loads(out.read_text(encoding="utf-8"))
    assert [line["target"] for line in content["lines"] if line["target"]] == [
        "≤ 2",
        "≤ 2",
        "≤ 0",
        "≤ 0",
    ]
    names = [line["name"] for line in content["lines"]]
    assert not [name for name in names if "turn-around" in name]
    assert "lateness, 100 Hz, controller, p99" in names
