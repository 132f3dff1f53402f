"""Worker processes end with the process that handed out the work, however it ends."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from steer_by_wire.closed_loop.processes.parallel_work import worker_pool
from steer_by_wire.runtime.exit_status import UserError
from tests.support.programs.running_program import PATIENCE_S, wait_until

PARENT = """
import os, sys, time
from steer_by_wire.closed_loop.processes.parallel_work import worker_pool

if __name__ == "__main__":
    with worker_pool(2) as pool:
        pids = [pool.submit(os.getpid) for _ in range(2)]
        print(*{pid.result() for pid in pids}, flush=True)
        pool.submit(time.sleep, 3600.0).result()
"""


def _is_there(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rsplit(")", 1)[1].split()[0]
    except OSError:
        return False
    return state not in "ZX"


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")
@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_workers_end_with_their_parent(end: signal.Signals, tmp_path: Path) -> None:
    script = tmp_path / "parent.py"
    script.write_text(PARENT, encoding="utf-8")
    command = (sys.executable, str(script))
    root = str(Path(__file__).resolve().parents[3])
    parent = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env={**os.environ, "PYTHONPATH": root},
    )
    assert parent.stdout is not None
    workers = [int(pid) for pid in parent.stdout.readline().split()]
    assert workers
    assert all(_is_there(pid) for pid in workers)
    parent.send_signal(end)
    parent.communicate(timeout=PATIENCE_S)
    wait_until(lambda: not any(map(_is_there, workers)), "the workers' end")


def test_workers_have_one_thread_each_and_the_environment_stays_as_it_was(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "3")
    before = dict(os.environ)
    with worker_pool(1) as pool:
        seen = [
            pool.submit(os.getenv, f"{name}_NUM_THREADS").result() for name in ("OMP", "OPENBLAS")
        ]
    assert seen == ["1", "1"]
    assert os.environ == before


def test_a_worker_that_is_killed_is_one_line_for_the_user() -> None:
    ended = pytest.raises(UserError, match=r"^a worker process was ended .*fewer workers")
    with ended, worker_pool(1) as pool:
        pool.submit(os._exit, 1).result()
