"""Processes that a program starts end with it, however it ends, without leaving anything."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from steer_by_wire.closed_loop.processes import process_group
from steer_by_wire.closed_loop.processes.process_group import Lifeline
from steer_by_wire.runtime.exit_status import ExitStatus
from tests.support.programs.running_program import PATIENCE_S, wait_until

ROOT = str(Path(__file__).resolve().parents[3])
NEEDS_SIGNALS = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no SIGKILL")
CHILD = """
import signal, sys, time
from pathlib import Path

def end(*_):
    Path(sys.argv[1]).write_text(f"{sys.argv[2:]} ended at {time.monotonic()}")
    sys.exit(7)

signal.signal(signal.SIGTERM, end)
print("ready", flush=True)
while True:
    time.sleep(3600.0)
"""
"""Ends in order when it is asked to, and else never."""
PARENT = """
import subprocess, sys, time
from contextlib import closing
from pathlib import Path
from steer_by_wire.closed_loop.processes import process_group
from steer_by_wire.closed_loop.processes.process_group import Lifeline, launched_broker
from steer_by_wire.runtime.command_line import run_main

def main():
    first, second, folder = sys.argv[1:]
    process_group.BROKER_AFTER_S = 0.3
    with launched_broker() as address, closing(Lifeline()) as line:
        children = [
            line.start("child", [first], subprocess.PIPE),
            line.start("child", [second], subprocess.PIPE, after_s=0.2, remove=Path(folder)),
        ]
        for child in children:
            child.stdout.readline()
        print(address, *(child.pid for child in children), flush=True)
        time.sleep(3600.0)

sys.exit(run_main("parent", main))
"""


@pytest.fixture
def environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Lets children find the project and the module ``child``."""
    (tmp_path / "child.py").write_text(CHILD, encoding="utf-8")
    (tmp_path / "parent.py").write_text(PARENT, encoding="utf-8")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join((ROOT, str(tmp_path))))


@contextmanager
def started(line: Lifeline, arguments: Sequence[str]) -> Iterator[subprocess.Popen[bytes]]:
    """Run the child until the end of the block."""
    with line.start("child", arguments, subprocess.PIPE) as child:
        assert child.stdout is not None
        try:
            assert child.stdout.readline() == b"ready\n"
            yield child
        finally:
            child.kill()


def is_gone(pid: int) -> Callable[[], bool]:
    """Return a function that checks whether a process has ended, reaped or not."""

    def answer() -> bool:
        try:
            stat = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8")
        except OSError:
            return True
        return stat.rsplit(")", 1)[1].split()[0] in "ZX"

    return answer


@NEEDS_SIGNALS
@pytest.mark.usefixtures("environment")
@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")
def test_what_was_started_ends_in_order_when_its_parent_is_killed(tmp_path: Path) -> None:
    folder = tmp_path / "private"
    folder.mkdir()
    (folder / "key").touch()
    files = [tmp_path / "first", tmp_path / "second"]
    command = [sys.executable, str(tmp_path / "parent.py"), *map(str, files), str(folder)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        address, *pids = parent.stdout.readline().split()
        killed_s = time.monotonic()
        parent.kill()
    for pid in map(int, pids):
        wait_until(is_gone(pid), f"end of {pid}")
    first_s, second_s = (float(file.read_text().split()[-1]) for file in files)
    assert first_s > killed_s
    assert second_s > killed_s + 0.2  # after_s
    wait_until(lambda: not folder.exists(), "removal of the private folder")
    wait_until(lambda: not Path(address).parent.exists(), "removal of the broker's folder")


@NEEDS_SIGNALS
@pytest.mark.usefixtures("environment")
def test_sigterm_ends_a_tool_as_ctrl_c_does(tmp_path: Path) -> None:
    files = [str(tmp_path / "first"), str(tmp_path / "second"), str(tmp_path / "none")]
    with subprocess.Popen(
        [sys.executable, str(tmp_path / "parent.py"), *files],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as parent:
        assert parent.stdout is not None
        address = Path(parent.stdout.readline().split()[0])
        parent.send_signal(signal.SIGTERM)
        _, errors = parent.communicate(timeout=PATIENCE_S)
    assert parent.returncode == ExitStatus.INTERRUPTED
    assert errors.splitlines()[-1] == "parent: error: interrupted"
    assert not address.parent.exists()
    wait_until(Path(files[1]).exists, "the end of what it had started")


@pytest.mark.usefixtures("environment")
def test_a_child_runs_as_the_module_that_it_is_and_ends_as_that_does(tmp_path: Path) -> None:
    ended = tmp_path / "ended"
    with closing(Lifeline()) as line:
        with started(line, [str(ended), "--after", "-m"]) as child:
            child.terminate()
            assert child.wait(PATIENCE_S) == 7
        assert ended.read_text().startswith("['--after', '-m'] ended")
        with line.start("json.tool", ["--help"], subprocess.PIPE) as other:
            assert b"json.tool" in other.communicate(timeout=PATIENCE_S)[0]
            assert other.returncode == 0


@pytest.mark.usefixtures("environment")
def test_a_sibling_does_not_hold_the_pipe(tmp_path: Path) -> None:
    """One that is started later must not keep the first alive, nor itself."""
    line = Lifeline()
    with (
        started(line, [str(tmp_path / "one")]) as one,
        started(line, [str(tmp_path / "two")]) as two,
    ):
        time.sleep(0.05)
        assert one.poll() is two.poll() is None
        line.close()
        assert one.wait(PATIENCE_S) == two.wait(PATIENCE_S) == 7


STUBBORN = """
import os, signal, time
signal.signal(signal.SIGINT, signal.SIG_IGN)
print("ready", os.getpid(), flush=True)
time.sleep(3600.0)
"""
POLITE = """
import signal, sys, time
from pathlib import Path
signal.signal(signal.SIGINT, signal.default_int_handler)
print("ready", flush=True)
try:
    time.sleep(3600.0)
except KeyboardInterrupt:
    Path(sys.argv[1]).touch()
"""


@NEEDS_SIGNALS
@pytest.mark.usefixtures("environment")
def test_a_crew_that_is_given_up_ends_in_order_and_who_does_not_is_killed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(process_group, "ABORT_TIMEOUT_S", 2.0)
    for name, code in (("stubborn", STUBBORN), ("polite", POLITE)):
        (tmp_path / f"{name}.py").write_text(code, encoding="utf-8")

    def give_up() -> None:
        with process_group.Processes(tmp_path) as running:
            running.start("first", "polite", [str(tmp_path / "first")])
            running.start("second", "stubborn", [])
            running.start("third", "polite", [str(tmp_path / "third")])
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        give_up()
    assert (tmp_path / "first").exists()
    assert (tmp_path / "third").exists()
    stubborn = int((tmp_path / "second.txt").read_text(encoding="utf-8").split()[-1])
    assert is_gone(stubborn)()
