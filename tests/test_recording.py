"""``--record``: every format holds what went through the port, and nothing holds up the program."""

import json
import os
import signal
import subprocess
import sys
import time
from base64 import b64encode
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from importlib.util import find_spec
from itertools import pairwise
from pathlib import Path
from typing import Any

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

import plant_emulator.program as plant_program
import runtime.recording
from runtime.candump import CandumpReader
from runtime.emulated_bus.launch import launched_broker
from runtime.frame import ERROR, EXTENDED, FD, REMOTE, Frame
from runtime.message import frame_of
from runtime.program import ExitStatus
from runtime.real_time import Received
from runtime.recording import (
    LEFT_OUT,
    SUFFIXES,
    Recording,
    RecordingFigures,
    RecordingPort,
    recording_obstacle,
)
from runtime.recording_file import HELD_NS, SYNC_NS, Sync, _ordered, _Record
from tests.running_program import ORDINARY, running, wait_until
from tools.log_analysis.log_file import LogError, open_log
from tools.vcan_backends.guard import descendants

Capture = pytest.CaptureFixture[str]
NEEDS_ASAMMDF = pytest.mark.skipif(
    find_spec("asammdf") is None, reason="asammdf is not installed (the extra mf4)"
)
FORMATS = [
    pytest.param(suffix, marks=NEEDS_ASAMMDF if suffix == ".mf4" else ()) for suffix in SUFFIXES
]
FRAMES = (
    Frame(0x100, bytes(range(8))),
    Frame(0x7FF, b""),
    Frame(0x1ABCDEF0, b"\x01", EXTENDED),
    Frame(0x123, b"", REMOTE),
    Frame(0x124, bytes(range(12)), FD),
    Frame(0x040, bytes(8), ERROR),
)
PERIOD_NS = 10_000_000
TEXT = (".log", ".asc", ".csv", ".trc")
KILLED_FRAMES = 1000


def record(path: Path, frames: list[Frame] | tuple[Frame, ...]) -> RecordingFigures:
    recording = Recording(path, "vcan0")
    start_ns = time.monotonic_ns()
    for index, frame in enumerate(frames):
        recording.take(frame, start_ns + index * PERIOD_NS, index % 2)
    return recording.close()


def messages_in(path: Path) -> list[can.Message]:
    with can.LogReader(path) as reader:
        return list(reader)


def known(frame: Frame) -> Frame:
    """What of a frame comes back: some formats keep neither kind nor content of error frames."""
    return Frame(0, b"", ERROR) if frame.flags & ERROR else frame


# What is in the file


@pytest.mark.parametrize("suffix", FORMATS)
def test_every_format_holds_the_frames_their_directions_and_distances(
    tmp_path: Path, suffix: str
) -> None:
    path = tmp_path / f"run{suffix}"
    figures = record(path, FRAMES)
    kept = [
        (index, frame)
        for index, frame in enumerate(FRAMES)
        if not frame.flags & LEFT_OUT.get(suffix, 0)
    ]
    assert figures == RecordingFigures(str(path), len(kept), 0, len(FRAMES) - len(kept), "")
    messages = messages_in(path)
    assert [known(frame_of(message)) for message in messages] == [known(f) for _, f in kept]
    first_s = messages[0].timestamp
    for message, (index, frame) in zip(messages, kept, strict=True):
        assert message.timestamp - first_s == pytest.approx(index * PERIOD_NS * 1e-9, abs=2e-6)
        if suffix not in (".csv", ".db") and not frame.flags & ERROR:
            assert message.is_rx is bool(index % 2)


def test_a_log_is_one_that_candump_could_have_written(tmp_path: Path) -> None:
    path = tmp_path / "run.log"
    before_ns = time.time_ns()
    record(path, FRAMES[:5])
    with path.open(encoding="ascii") as lines:
        reader = CandumpReader(lines)
        entries = list(reader)
    assert reader.unreadable == 0
    assert [entry.frame for entry in entries] == list(FRAMES[:5])
    assert {entry.channel for entry in entries} == {"vcan0"}
    assert before_ns - 1000 <= entries[0].time_ns <= time.time_ns()


def test_frames_that_waited_are_put_where_they_belong(tmp_path: Path) -> None:
    path = tmp_path / "run.asc"
    recording = Recording(path, "vcan0")
    start_ns = time.monotonic_ns()
    for number in (1, 0, 3, 2, 5, 4):
        recording.take(Frame(number, b""), start_ns + number * 1_000_000, 1)
    recording.close()
    messages = messages_in(path)
    assert [message.arbitration_id for message in messages] == [0, 1, 2, 3, 4, 5]
    times = [message.timestamp for message in messages]
    assert times == sorted(times)
    assert times[5] - times[0] == pytest.approx(5e-3, abs=2e-6)


@pytest.mark.parametrize("suffix", [".log", ".db"])
def test_a_recording_replaces_the_file_that_is_there(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"run{suffix}"
    record(path, FRAMES[:3])
    record(path, FRAMES[:2])
    assert len(messages_in(path)) == 2


def test_a_database_holds_also_the_last_of_many_frames(tmp_path: Path) -> None:
    """The writer's own thread ends with one more batch, however many frames wait for it."""
    path = tmp_path / "run.db"
    assert record(path, [Frame(1, bytes(8))] * 3000).frames == 3000
    assert len(messages_in(path)) == 3000


# What the port does


class FakePort:
    def __init__(self, waiting: list[Received], has_room: bool = True) -> None:
        self.waiting = waiting
        self.has_room = has_room

    def recv(self, timeout_s: float) -> Received | None:  # noqa: ARG002
        return self.waiting.pop(0) if self.waiting else None

    def send(self, frame: Frame) -> bool:  # noqa: ARG002
        return self.has_room


def test_a_port_records_what_was_received_and_sent_and_not_what_was_refused(
    tmp_path: Path,
) -> None:
    path = tmp_path / "run.log"
    recording = Recording(path, "vcan0")
    now_ns = time.monotonic_ns()
    inner = FakePort([Received(Frame(1, b"\1"), now_ns), Received(Frame(2, b"\2"), None)])
    port = RecordingPort(inner, recording, lambda: now_ns + 5_000_000)
    assert port.recv(0.0) == Received(Frame(1, b"\1"), now_ns)
    assert port.recv(0.0) == Received(Frame(2, b"\2"), None)
    assert port.recv(0.0) is None
    assert port.send(Frame(3, b"\3"))
    inner.has_room = False
    assert not port.send(Frame(4, b"\4"))
    assert recording.close().frames == 3
    messages = messages_in(path)
    assert [(m.arbitration_id, m.is_rx) for m in messages] == [(1, True), (2, True), (3, False)]
    assert messages[1].timestamp - messages[0].timestamp == pytest.approx(5e-3, abs=2e-6)


@pytest.mark.skipif(sys.platform == "win32", reason="Windows cannot stop a process")
def test_a_recorder_that_stands_still_costs_frames_and_no_time(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    recording = Recording(path, "vcan0")
    recorder = recording._recorder.pid
    os.kill(recorder, signal.SIGSTOP)
    taken = 200_000  # 5 MB: whatever the pipe holds, this is more
    for index in range(taken):
        recording.take(Frame(index % 2048, bytes(8)), index, 0)  # would wait for ever if it waited
    os.kill(recorder, signal.SIGCONT)
    figures = recording.close()
    assert figures.dropped > 0
    assert figures.frames > 1000
    assert figures.frames + figures.dropped == taken
    assert len(messages_in(path)) == figures.frames


def test_the_way_of_platforms_whose_pipes_wait_is_bounded_too(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(runtime.recording, "_QUEUED_MAX", 10)
    read_end, write_end = os.pipe()
    offer, end = runtime.recording._offering_by_thread(write_end)
    offered = 0
    while offer(bytes(4096)):  # the pipe is full at some point, then the queue
        offered += 1
    got = 0
    while got < offered * 4096:
        got += len(os.read(read_end, 1 << 16))
    assert offer(b"last")
    end()
    os.close(write_end)
    assert os.read(read_end, 100) == b"last"
    os.close(read_end)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
def test_a_full_disk_is_told_and_the_frames_are_counted(tmp_path: Path) -> None:
    path = tmp_path / "run.log"
    path.symlink_to("/dev/full")
    recording = Recording(path, "vcan0")
    recorder = recording._recorder
    taken = 0
    while recorder.poll() is None:  # until it has noticed, and given up
        recording.take(Frame(1, bytes(8)), taken * PERIOD_NS, 0)
        taken += 1
        time.sleep(0.001)
    recording.take(Frame(1, bytes(8)), taken * PERIOD_NS, 0)
    figures = recording.close()
    assert figures.failure == "No space left on device"
    assert figures.dropped >= 1


KILLED = """
import os, signal, sys, time
from pathlib import Path
from runtime.frame import Frame
from runtime.recording import Recording

recording = Recording(Path(sys.argv[1]), "vcan0")
for index in range(1000):
    recording.take(Frame(index, bytes(8)), time.monotonic_ns(), 0)
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGKILL")
@pytest.mark.parametrize("suffix", [".log", ".blf", ".db"])
def test_a_program_that_is_killed_leaves_a_complete_file(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"run{suffix}"
    killed = subprocess.run([sys.executable, "-c", KILLED, str(path)], check=False)
    assert killed.returncode == -signal.SIGKILL

    def is_complete() -> bool:
        if suffix == ".blf" and int.from_bytes(path.read_bytes()[32:36], "little") < 1000:
            return False  # its header counts the frames when it is closed
        with suppress(Exception):  # it is still being written
            return len(messages_in(path)) == 1000
        return False

    wait_until(is_complete, f"1000 frames in {path}")


@pytest.mark.parametrize("suffix", TEXT)
def test_after_a_pause_the_file_holds_everything_and_the_recorder_may_be_killed(
    tmp_path: Path, suffix: str
) -> None:
    path = tmp_path / f"run{suffix}"
    recording = Recording(path, "vcan0")
    start_ns = time.monotonic_ns()
    for index in range(KILLED_FRAMES):
        recording.take(Frame(0x100, index.to_bytes(8, "big")), start_ns + index * PERIOD_NS, 0)
    last = (KILLED_FRAMES - 1).to_bytes(8, "big")
    wait_until(lambda: last in written(path), f"the last of {KILLED_FRAMES} frames in {path}")
    os.kill(recording._recorder.pid, signal.SIGKILL)
    figures = recording.close()
    assert figures.failure == "the recorder was ended before it could finish the file"
    assert written(path) == [index.to_bytes(8, "big") for index in range(KILLED_FRAMES)]


def test_killed_while_frames_come_the_recorder_leaves_all_that_was_there_in_order(
    tmp_path: Path,
) -> None:
    path = tmp_path / "run.log"
    recording = Recording(path, "vcan0")
    start_ns = time.monotonic_ns()
    taken = 0
    seen = 0
    while seen < KILLED_FRAMES:
        for _ in range(100):
            recording.take(Frame(0x100, taken.to_bytes(8, "big")), start_ns + taken * 10_000, 0)
            taken += 1
        seen = path.read_text().count("\n")
    os.kill(recording._recorder.pid, signal.SIGKILL)
    recording.close()
    payloads = written(path)
    assert len(payloads) >= seen
    assert payloads == [index.to_bytes(8, "big") for index in range(len(payloads))]


BOTH_KILLED = """
import os, signal, sys, time
from pathlib import Path
from runtime.frame import Frame
from runtime.recording import Recording

path = Path(sys.argv[1])
recording = Recording(path, "vcan0")
start_ns = time.monotonic_ns()
for index in range(1000):
    recording.take(Frame(0x100, index.to_bytes(8, "big")), start_ns + index * 10_000_000, 0)
while path.read_text().count("\\n") < 990:  # all but what is held
    time.sleep(0.01)
os.kill(recording._recorder.pid, signal.SIGKILL)
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_program_and_recorder_killed_together_leave_all_but_the_last_tenth_of_a_second(
    tmp_path: Path,
) -> None:
    path = tmp_path / "run.log"
    killed = subprocess.run([sys.executable, "-c", BOTH_KILLED, str(path)], check=False)
    assert killed.returncode == -signal.SIGKILL
    payloads = written(path)
    assert len(payloads) >= 990
    assert payloads == [index.to_bytes(8, "big") for index in range(len(payloads))]


@given(
    st.lists(
        st.lists(st.integers(0, 5 * HELD_NS), max_size=5),
        max_size=10,
    )
)
def test_nothing_is_held_but_the_newest_tenth_of_a_second_and_nothing_after_a_pause(
    reads: list[list[int]],
) -> None:
    records = [
        [_Record(time_ns, 100 * read + n, FRAMES[0], True) for n, time_ns in enumerate(times)]
        for read, times in enumerate(reads)
    ]
    fed: list[_Record] = []

    def feed() -> Iterator[list[_Record]]:
        for read in records:
            fed.extend(read)
            yield read

    given_out: list[_Record] = []
    for read, ripe in zip(records, ordered := _ordered(feed()), strict=False):
        given_out += ripe
        held = set(fed) - set(given_out)
        newest_ns = max((item.time_ns for item in fed), default=0)
        assert all(item.time_ns > newest_ns - HELD_NS for item in held)
        assert read or not held
    for ripe in ordered:
        given_out += ripe
    assert sorted(given_out) == sorted(fed)


def test_what_was_written_reaches_the_disk_at_most_twice_a_second_and_not_for_nothing() -> None:
    now_ns, synced = 0, []

    def disk(descriptor: int) -> None:
        nonlocal now_ns
        synced.append((descriptor, now_ns))
        now_ns += SYNC_NS // 5  # it takes its time
        raise OSError("a pipe has no disk")

    sync = Sync(7, disk, lambda: now_ns)
    while now_ns < 10 * SYNC_NS:
        sync.after_write(1)
        now_ns += SYNC_NS // 50
    assert all(descriptor == 7 for descriptor, _ in synced)
    times = [at_ns for _, at_ns in synced]
    distances = [after - before for before, after in pairwise(times)]
    assert min(distances) >= SYNC_NS + SYNC_NS // 5
    assert max(distances) <= SYNC_NS + SYNC_NS // 5 + SYNC_NS // 50
    count = len(synced)
    sync.after_write(1)
    for _ in range(100):
        now_ns += SYNC_NS
        sync.after_write(0)
    assert len(synced) == count + 1


@pytest.mark.parametrize("suffix", TEXT)
def test_a_torn_last_line_is_no_frame(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"run{suffix}"
    frames = [Frame(0x100, bytes([n] * 8)) for n in range(5)]
    record(path, frames)
    # From the last frame's line on: a killed writer has written no footer either.
    whole = path.read_bytes()
    lines = whole.splitlines(keepends=True)
    last = max(n for n, line in enumerate(lines) if is_line_of(frames[-1], line))
    begin = sum(map(len, lines[:last]))
    for length in range(len(lines[last])):
        path.write_bytes(whole[: begin + length])
        log = open_log(path)
        assert [logged.frame for logged in log] == frames[:-1]
        assert log.unreadable == bool(length)
        assert not length or "the last line has no end" in log.first_unreadable


def test_the_reader_of_candump_s_logs_knows_a_torn_last_line_too() -> None:
    line = "(1.000000) vcan0 100#0011223344556677 R\n"
    for length in range(1, len(line)):
        reader = CandumpReader([line, line[:length]])
        assert len(list(reader)) == 1
        assert reader.unreadable == 1
    assert len(list(CandumpReader([line.strip(), line.strip()]))) == 2  # no file: there are no ends


def written(path: Path) -> list[bytes]:
    """Payloads of all frames that can be read in a text log, which may have no end."""
    payloads: list[bytes] = []
    with suppress(LogError):  # there is no frame yet
        payloads.extend(logged.frame.data for logged in open_log(path))
    return payloads


def is_line_of(frame: Frame, line: bytes) -> bool:
    """Whether a line of some format holds the frame's payload."""
    spelled = {frame.data.hex(), frame.data.hex(" "), b64encode(frame.data).decode()}
    return any(text.encode() in line.lower() or text.encode() in line for text in spelled)


# What a user may get wrong


def test_names_that_are_no_recordings_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    assert [recording_obstacle(Path(f"run{s.upper()}")) for s in SUFFIXES if s != ".mf4"] == [
        ""
    ] * 6
    assert "run.txt: records as .log, .asc" in recording_obstacle(Path("run.txt"))
    monkeypatch.setattr(runtime.recording, "find_spec", lambda _name: None)
    assert "pip install 'steer-by-wire-emulator[mf4]'" in recording_obstacle(Path("run.mf4"))


@pytest.mark.parametrize("name", ["run.txt", "run", "nowhere/run.log"])
def test_a_bad_name_ends_a_program_with_one_clear_line_and_status_2(
    tmp_path: Path, capsys: Capture, name: str
) -> None:
    with pytest.raises(SystemExit) as ended:
        plant_program.main(["--record", str(tmp_path / name)])
    assert ended.value.code == ExitStatus.SETTINGS
    assert "argument --record: " in capsys.readouterr().err.splitlines()[-1]


@pytest.fixture
def run_plant(
    tmp_path: Path, request: pytest.FixtureRequest
) -> Callable[..., tuple[int, dict[str, Any]]]:
    def run(*options: str) -> tuple[int, dict[str, Any]]:
        report = tmp_path / "report.json"
        bus = ["-i", "virtual", "-c", request.node.name, "--duration", "0.3", *ORDINARY]
        status = plant_program.main([*bus, "--report", str(report), *options])
        return status, json.loads(report.read_text())

    return run


def test_a_report_says_what_was_recorded(
    run_plant: Callable[..., tuple[int, dict[str, Any]]],
    tmp_path: Path,
    capsys: Capture,
) -> None:
    path = tmp_path / "run.blf"
    status, report = run_plant("--record", str(path))
    assert status == ExitStatus.OK
    sent = report["loop"]["frames_sent"]
    assert report["recording"] == {
        "file": str(path), "frames": sent, "dropped": 0, "left_out": 0, "failure": ""
    }  # fmt: skip
    assert len(messages_in(path)) == sent
    assert f"{sent} frames recorded in {path}" in capsys.readouterr().out


def test_without_the_option_nothing_is_recorded(
    run_plant: Callable[..., tuple[int, dict[str, Any]]],
) -> None:
    status, report = run_plant()
    assert (status, report["recording"]) == (ExitStatus.OK, None)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
def test_a_recording_that_fails_leaves_the_report_and_status_4(
    run_plant: Callable[..., tuple[int, dict[str, Any]]],
    tmp_path: Path,
    capsys: Capture,
) -> None:
    path = tmp_path / "run.log"
    path.symlink_to("/dev/full")
    status, report = run_plant("--record", str(path))
    assert status == ExitStatus.OUTPUT
    assert report["recording"]["failure"] == "No space left on device"
    assert f"error: {path}: No space left on device" in capsys.readouterr().err


@pytest.mark.skipif(sys.platform != "linux", reason="finds the recorder in /proc")
def test_ctrl_c_ends_a_program_whose_recording_cannot_be_opened_and_its_recorder(
    tmp_path: Path,
) -> None:
    path = tmp_path / "run.log"
    os.mkfifo(path)  # opening it waits for somebody who reads
    options = ["-i", "virtual", "-c", "0", "--record", str(path)]
    # A shell has programs in the background ignore Ctrl-C, and they would inherit that.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    with subprocess.Popen(
        [sys.executable, "-m", "controller", *options], stderr=subprocess.PIPE, text=True
    ) as program:
        try:
            signal.signal(signal.SIGINT, before)
            wait_until(lambda: any(map(is_recording, descendants(program.pid))), "a recorder")
            (recorder,) = descendants(program.pid)
            program.send_signal(signal.SIGINT)
            _, said = program.communicate(timeout=30.0)
        finally:
            program.kill()
    assert program.returncode == ExitStatus.INTERRUPTED
    assert said.splitlines()[-1] == "steering-controller: error: interrupted"
    assert not Path(f"/proc/{recorder}").exists()


def is_recording(pid: int) -> bool:
    """Whether a recorder has come to where it ignores SIGINT, just before it opens the file."""
    with suppress(OSError):
        status = Path(f"/proc/{pid}/status").read_text()
        ignored = int(status.partition("SigIgn:")[2].split()[0], 16)
        return bool(ignored & 1 << signal.SIGINT - 1)
    return False


# Two programs


@pytest.fixture
def broker() -> Iterator[str]:
    with launched_broker() as address:
        yield address


def test_both_programs_record_the_same_frames_and_keep_them_on_ctrl_c(
    broker: str, tmp_path: Path
) -> None:
    bus = ["-i", "emulated", "-c", "can0", "--bus-kwargs", f"address={broker}"]
    logs = {"plant_emulator": tmp_path / "plant.asc", "controller": tmp_path / "controller.log"}
    log = logs["controller"]
    sent, received = {}, {}
    with ExitStack() as stack:
        programs = {
            name: stack.enter_context(
                running(name, [*bus, "--record", str(path)], tmp_path / f"{name}.json")
            )
            for name, path in logs.items()
        }
        # Text is handed to the operating system as it comes, so it can be looked at meanwhile.
        wait_until(lambda: log.read_text().count(" T\n") > 60, f"commands in {log}")
        for name, program in programs.items():
            assert program.interrupt() == ExitStatus.OK
            report = program.report()
            messages = messages_in(logs[name])
            sent[name] = [frame_of(message) for message in messages if not message.is_rx]
            received[name] = [frame_of(message) for message in messages if message.is_rx]
            assert len(messages) == report["recording"]["frames"]
            assert len(sent[name]) == report["loop"]["frames_sent"]
            assert len(received[name]) == report["loop"]["frames_received"]
    assert not Counter(received["controller"]) - Counter(sent["plant_emulator"])
    assert not Counter(received["plant_emulator"]) - Counter(sent["controller"])
    assert len(received["plant_emulator"]) > 50
