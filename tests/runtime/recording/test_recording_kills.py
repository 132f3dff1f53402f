"""Recordings whose program or recorder is killed or held up."""

import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest

from steer_by_wire.closed_loop.recordings.log_file import open_log
from steer_by_wire.closed_loop.recordings.logged import LogError
from steer_by_wire.runtime.frame import Frame
from steer_by_wire.runtime.recording.recorder import Recording
from tests.support.frames.recorded_frames import messages_in
from tests.support.programs.running_program import wait_until

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


def test_a_killed_recorder_leaves_all_in_order(tmp_path: Path) -> None:
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


def written(path: Path) -> list[bytes]:
    """Payloads of all frames that can be read in a text log, which may have no end."""
    payloads: list[bytes] = []
    with suppress(LogError):  # there is no frame yet
        payloads.extend(logged.frame.data for logged in open_log(path))
    return payloads
