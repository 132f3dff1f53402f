"""``tools/with_vcan``: what the command finds, what comes back, and that nothing stays behind.

User Mode Linux is tried from here. The other two ways need a kernel with vcan: those tests run on
one (``tests/vcan_session.py``), below a wrapper themselves.
"""

import os
import select
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import IO, NamedTuple

import pytest

from steer_by_wire.with_vcan.backend_choice import choose
from steer_by_wire.with_vcan.guard import descendants
from steer_by_wire.with_vcan.request import BackendError, Request
from tests.support.programs.running_program import PATIENCE_S, wait_until

ROOT = Path(__file__).resolve().parents[3]
WITH_VCAN = str(ROOT / "tools" / "with_vcan")
COMMAND = (sys.executable, "-S", WITH_VCAN)
"""It takes the standard library alone. Where ``python3`` is a script that looks for the
interpreter, as pyenv's, that takes longer than the test."""
NOBODY = 65534

HOST = pytest.param("host", marks=pytest.mark.vcan)
NAMESPACE = pytest.param("namespace", marks=pytest.mark.vcan)


@pytest.fixture(params=[NAMESPACE, "uml"])
def backend(request: pytest.FixtureRequest) -> str:
    """A backend; one that this machine does not have skips the test."""
    name: str = request.param
    if missing := obstacle(name):
        pytest.skip(missing)
    return name


@cache
def obstacle(name: str) -> str:
    try:
        choose(name, Request(("true",)))
    except BackendError as error:
        return str(error)
    return ""


def run(
    *arguments: str,
    cwd: Path | None = None,
    variables: Mapping[str, str] | None = None,
    file_mask: int = -1,
    given: str = "",
) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*COMMAND, *arguments],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
        check=False,
        cwd=cwd,
        env={**os.environ, **(variables or {})},
        umask=file_mask,
        input=given,
    )


class Wrapper(NamedTuple):
    """A running wrapper and what its command prints."""

    process: subprocess.Popen[str]
    output: IO[str]


@contextmanager
def wrapper(*arguments: str) -> Iterator[Wrapper]:
    """Run with_vcan during the block, as a shell does: with a process group of its own."""
    with subprocess.Popen(
        [*COMMAND, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as process:
        assert process.stdout is not None
        try:
            yield Wrapper(process, process.stdout)
        finally:
            process.kill()


def is_alive(pid: int) -> bool:
    with suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    return False


@pytest.mark.parametrize("backend", [HOST, NAMESPACE, "uml"], indirect=True)
def test_the_command_finds_vcan0_and_all_that_it_had_outside(backend: str, tmp_path: Path) -> None:
    script = (
        "import os, socket, subprocess, sys;"
        "s = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW); s.bind(('vcan0',));"
        "print(os.getcwd(), os.getuid(), os.getgid(), oct(os.umask(0)), os.environ['A_VARIABLE']);"
        "print(sys.argv[1:], sys.stdin.read(), sys.stdout.isatty());"
        "print(os.environ['WITH_VCAN_BACKEND']);"
        "print(open('/sys/class/net/vcan0/mtu').read().strip());"
        "print(os.readlink('/proc/self/ns/net'));"
        "print(subprocess.Popen(('sleep', '1000'), stdout=2).pid);"
        "print('complaint', file=sys.stderr);"
        "open('made', 'w').write('here');"
        "sys.exit(7)"
    )
    done = run(
        "--backend", backend, sys.executable, "-c", script, "a b", "'\"$x", "--timeout",
        cwd=tmp_path, variables={"A_VARIABLE": "ä \n'\""}, file_mask=0o27, given="fed",
    )  # fmt: skip
    *lines, network, left = done.stdout.splitlines()
    assert lines == [
        f"{tmp_path} {os.getuid()} {os.getgid()} 0o27 ä ",
        "'\"",
        "['a b', '\\'\"$x', '--timeout'] fed False",
        backend,
        "72",
    ], done
    assert done.stderr == "complaint\n"
    assert done.returncode == 7
    assert (tmp_path / "made").read_text() == "here"
    if backend != "uml":  # that is a kernel of its own
        assert (network == os.readlink("/proc/self/ns/net")) is (backend == "host")
    if backend == "namespace":
        assert not is_alive(int(left)), "what the command leaves running ends with it"


@pytest.mark.skipif(os.name != "posix" or os.geteuid() != 0, reason="only root may become another")
def test_an_ordinary_user_stays_who_it_is(backend: str) -> None:
    readable = all(path.stat().st_mode & 0o5 for path in (ROOT, *ROOT.parents))
    if not (readable and os.access("/usr/bin/env", os.X_OK)):
        pytest.skip("this folder is not for others to read")
    script = "id -u; id -g; ls -d /sys/class/net/vcan0"
    done = subprocess.run(
        ["python3", "-B", WITH_VCAN, "--backend", backend, "sh", "-c", script],
        capture_output=True, text=True, timeout=PATIENCE_S, check=False, cwd="/",
        user=NOBODY, group=NOBODY, extra_groups=[],
    )  # fmt: skip
    if done.returncode == 3:
        pytest.skip(f"not for an ordinary user: {done.stderr}")
    assert done.stdout.split() == [str(NOBODY), str(NOBODY), "/sys/class/net/vcan0"], done


@pytest.mark.parametrize("backend", ["uml"], indirect=True)
def test_much_output_comes_through_whole_while_both_streams_flow(backend: str) -> None:
    # What still runs must not keep the streams open.
    script = "sleep 1000 & seq 1 60000 >&2 & seq 1 50000; wait $!"
    done = run("--backend", backend, "sh", "-c", script)
    assert done.stdout == "".join(f"{number}\n" for number in range(1, 50001))
    assert done.stderr == "".join(f"{number}\n" for number in range(1, 60001))


def test_the_time_is_limited_also_where_nobody_reads_the_output(
    backend: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    timeout_s = "4" if backend == "uml" else "1"  # it has to boot
    options = ("--backend", backend, "--timeout", timeout_s)
    with wrapper(*options, "sh", "-c", "sleep 1000 & yes") as (process, _):
        assert process.wait(PATIENCE_S) == 124
        assert process.stderr is not None
        assert f"ended after {timeout_s} s" in process.stderr.read()
    assert list(tmp_path.iterdir()) == []


def test_a_signal_reaches_the_command_and_its_answer_comes_back(backend: str) -> None:
    script = "trap 'echo caught; exit 9' TERM; echo ready; while :; do sleep 0.05; done"
    with wrapper("--backend", backend, "sh", "-c", script) as (process, output):
        assert output.readline() == "ready\n"
        process.terminate()
        assert output.read() == "caught\n"
        assert process.wait(PATIENCE_S) == 9


def test_ctrl_c_at_the_terminal_comes_once(backend: str) -> None:
    script = (
        "n=0; trap 'n=$((n+1))' INT; stty size; while [ $n = 0 ]; do sleep 0.1; done; i=0; "
        "while [ $i -lt 3 ]; do sleep 0.2; i=$((i+1)); done; echo $n times; tty; exit 5"
    )
    terminal, theirs = os.openpty()
    command = ["setsid", "--ctty", *COMMAND, "--backend", backend, "sh", "-c", script]
    with subprocess.Popen(command, stdin=theirs, stdout=theirs, stderr=theirs) as process:
        os.close(theirs)
        shown = read_terminal(terminal, until="0 0")
        os.write(terminal, b"\x03")
        shown += read_terminal(terminal)
        assert process.wait(PATIENCE_S) == 5, shown
    os.close(terminal)
    assert "1 times" in shown
    assert "/dev/pts/" in shown


def read_terminal(terminal: int, until: str = "\0") -> str:
    shown = ""
    while until not in shown and select.select([terminal], [], [], PATIENCE_S)[0]:
        try:
            shown += os.read(terminal, 4096).decode()
        except OSError:  # a terminal signals its end by an error
            break
    return shown


def test_nothing_stays_when_the_wrapper_is_killed(
    backend: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    with wrapper("--backend", backend, "sh", "-c", "sleep 1000 & echo ready; sleep 1000") as (
        process,
        output,
    ):
        assert output.readline() == "ready\n"
        below = descendants(process.pid)
        assert len(below) >= 2
        process.kill()
        process.wait()
        wait_until(lambda: not any(map(is_alive, below)), "all have ended")
    wait_until(lambda: list(tmp_path.iterdir()) == [], "its folder is gone")


@pytest.mark.parametrize(("command", "status"), [("/absent", 127), ("/", 126)])
def test_a_command_that_cannot_be_run_is_reported_as_by_a_shell(command: str, status: int) -> None:
    code = f"from steer_by_wire.with_vcan.guard import execute; execute([{command!r}], {{}})"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == status
    assert done.stderr.startswith(f"with-vcan: error: {command}: ")


STOPPED_UNDER_A_TRACER = """
import ctypes, os, signal, time
from steer_by_wire.with_vcan.guard import reap
child = os.fork()
if child == 0:
    ctypes.CDLL(None).ptrace(0, 0, None, None)  # PTRACE_TRACEME
    os.kill(os.getpid(), signal.SIGTRAP)
    os._exit(0)
while open(f"/proc/{child}/stat").read().rpartition(")")[2].split()[0] != "t":
    time.sleep(0.01)
assert reap() == {}, "it has stopped, not ended"
os.kill(child, signal.SIGKILL)
ended = {}
while not ended:
    ended = reap()
    time.sleep(0.01)
assert ended == {child: 128 + signal.SIGKILL}, ended
"""


def test_a_process_that_a_tracer_has_stopped_is_not_taken_for_one_that_ended() -> None:
    subprocess.run([sys.executable, "-c", STOPPED_UNDER_A_TRACER], cwd=ROOT, check=True)
