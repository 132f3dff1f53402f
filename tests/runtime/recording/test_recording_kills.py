"""What a recording holds when its program or its recorder is killed or held up."""

import errno
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.closed_loop.recordings.log_file import LogError, open_log
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.recording.recorder_process import (
    HELD_NS,
    SYNC_NS,
    Sync,
    _ordered,
    _Record,
)
from steer_by_wire.runtime.recording.recording import Recording
from tests.support.frames.recorded_frames import FRAMES, messages_in
from tests.support.programs.running_program import wait_until

PERIOD_NS = 10_000_000
TEXT = (".log", ".asc", ".csv", ".trc")
KILLED_FRAMES = 1000
KILLED = """
import os, signal, sys, time
from pathlib import Path
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.recording.recording import Recording

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
    told: list[str] = []
    recording = Recording(path, "vcan0", told.append)
    start_ns = time.monotonic_ns()
    for index in range(KILLED_FRAMES):
        recording.take(Frame(0x100, index.to_bytes(8, "big")), start_ns + index * PERIOD_NS, 0)
    last = (KILLED_FRAMES - 1).to_bytes(8, "big")
    wait_until(lambda: last in written(path), f"the last of {KILLED_FRAMES} frames in {path}")
    os.kill(recording.recorder.pid, signal.SIGKILL)
    recording.recorder.wait()
    assert not told
    recording.take(Frame(0x100, bytes(8)), start_ns + KILLED_FRAMES * PERIOD_NS, 0)
    assert told == ["the recorder was ended before it could finish the file"]
    figures = recording.close()
    assert figures == (str(path), KILLED_FRAMES, 1, 0, *told)
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
    os.kill(recording.recorder.pid, signal.SIGKILL)
    recording.close()
    payloads = written(path)
    assert len(payloads) >= seen
    assert payloads == [index.to_bytes(8, "big") for index in range(len(payloads))]


def test_a_blf_whose_recorder_is_killed_has_all_but_the_last_moment_and_the_time_of_the_start(
    tmp_path: Path,
) -> None:
    """python-can's writer alone has neither the first 128 KiB nor the time."""
    path = tmp_path / "run.blf"
    recording = Recording(path, "vcan0")
    earliest_s, start_ns, latest_s = time.time(), time.monotonic_ns(), time.time()
    for index in range(KILLED_FRAMES):
        recording.take(Frame(0x100, index.to_bytes(8, "big")), start_ns + index * PERIOD_NS, 0)

    def counted() -> int:
        return int.from_bytes(path.read_bytes()[32:36], "little")  # by the header

    def noted() -> int:
        """Return what the recorder has noted for the program, after it was in the file."""
        return int.from_bytes(os.pread(recording._progress.fileno(), 8, 0), sys.byteorder)

    wait_until(
        lambda: counted() == noted() == KILLED_FRAMES,
        f"{KILLED_FRAMES} frames in {path}, and noted",
    )
    os.kill(recording.recorder.pid, signal.SIGKILL)
    figures = recording.close()
    assert figures.frames == KILLED_FRAMES
    messages = messages_in(path)
    assert [message.data for message in messages] == [
        index.to_bytes(8, "big") for index in range(KILLED_FRAMES)
    ]
    slewed_s = 0.1  # wall clock against monotonic clock, since the recording was opened
    assert earliest_s - slewed_s < messages[0].timestamp < latest_s + slewed_s
    assert messages[-1].timestamp - messages[0].timestamp == pytest.approx(
        1e-9 * (KILLED_FRAMES - 1) * PERIOD_NS, abs=1e-3
    )


BOTH_KILLED = """
import os, signal, sys, time
from pathlib import Path
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.recording.recording import Recording

path = Path(sys.argv[1])
recording = Recording(path, "vcan0")
start_ns = time.monotonic_ns()
for index in range(1000):
    recording.take(Frame(0x100, index.to_bytes(8, "big")), start_ns + index * 10_000_000, 0)
while path.read_text().count("\\n") < 990:  # all but what is held
    time.sleep(0.01)
os.kill(recording.recorder.pid, signal.SIGKILL)
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


@given(st.lists(st.lists(st.integers(0, 5 * HELD_NS), max_size=5), max_size=10))
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
        raise OSError(errno.EINVAL, "a pipe has no disk")

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


def written(path: Path) -> list[bytes]:
    """Payloads of all frames that can be read in a text log, which may have no end."""
    payloads: list[bytes] = []
    with suppress(LogError):  # there is no frame yet
        payloads.extend(logged.frame.data for logged in open_log(path))
    return payloads
