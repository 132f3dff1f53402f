"""Recordings whose program or recorder is killed or held up."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.closed_loop.recordings.log_file import open_log
from steer_by_wire.closed_loop.recordings.log_state import LogError
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.recording.recorder import Recording
from steer_by_wire.runtime.recording.recorder_process import HELD_NS, _ordered, _Record
from tests.support.frames.recorded_frames import FRAMES, messages_in
from tests.support.programs.running_program import wait_until

PERIOD_NS = 10_000_000
TEXT = (".log", ".asc")
KILLED_FRAMES = 1000
KILLED = """
import os, signal, sys, time
from pathlib import Path
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.recording.recorder import Recording

recording = Recording(Path(sys.argv[1]), "vcan0")
for index in range(1000):
    recording.record(Frame(index, bytes(8)), time.monotonic_ns(), is_received=False)
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGKILL")
@pytest.mark.parametrize("suffix", [".log", ".blf"])
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
def test_after_a_pause_the_file_holds_everything(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"run{suffix}"
    told: list[str] = []
    recording = Recording(path, "vcan0", told.append)
    start_ns = time.monotonic_ns()
    for index in range(KILLED_FRAMES):
        recording.record(
            Frame(0x100, index.to_bytes(8, "big")), start_ns + index * PERIOD_NS, is_received=False
        )
    last = (KILLED_FRAMES - 1).to_bytes(8, "big")
    wait_until(lambda: last in written(path), f"the last of {KILLED_FRAMES} frames in {path}")
    os.kill(recording.recorder.pid, signal.SIGKILL)
    recording.recorder.wait()
    assert not told
    recording.record(
        Frame(0x100, bytes(8)), start_ns + KILLED_FRAMES * PERIOD_NS, is_received=False
    )
    assert told == ["the recorder was ended before it could finish the file"]
    figures = recording.close()
    assert figures == (str(path), 0, KILLED_FRAMES + 1, *told)
    assert written(path) == [index.to_bytes(8, "big") for index in range(KILLED_FRAMES)]


def test_a_killed_recorder_leaves_all_in_order(
    tmp_path: Path,
) -> None:
    path = tmp_path / "run.log"
    recording = Recording(path, "vcan0")
    start_ns = time.monotonic_ns()
    taken = 0
    seen = 0
    while seen < KILLED_FRAMES:
        for _ in range(100):
            recording.record(
                Frame(0x100, taken.to_bytes(8, "big")), start_ns + taken * 10_000, is_received=False
            )
            taken += 1
        seen = path.read_text().count("\n")
    os.kill(recording.recorder.pid, signal.SIGKILL)
    recording.close()
    payloads = written(path)
    assert len(payloads) >= seen
    assert payloads == [index.to_bytes(8, "big") for index in range(len(payloads))]


@given(st.lists(st.lists(st.integers(0, 5 * HELD_NS), max_size=5), max_size=10))
def test_nothing_is_held_but_the_newest_tenth_of_a_second(
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


def written(path: Path) -> list[bytes]:
    """Payloads of all frames that can be read in a text log, which may have no end."""
    payloads: list[bytes] = []
    with suppress(LogError):  # there is no frame yet
        payloads.extend(logged.frame.data for logged in open_log(path))
    return payloads
