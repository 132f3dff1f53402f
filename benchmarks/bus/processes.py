"""Compiles the benchmark's C programs, and runs all: nothing is timed before all of them are ready.

    C loop      SCHED_FIFO above the others, so that a slow tick of ours cannot delay it; on the
                processor of the program it is compared with, as a host stops them one by one
    answering   SCHED_FIFO as requested
    requester   below both: it records what has happened when no other program has work to do

Where the host does not grant SCHED_FIFO, all are ordinary processes.
"""

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from steer_by_wire.closed_loop.processes.process_group import ProcessError
from steer_by_wire.runtime.exit_status import BusError

SOURCES = Path(__file__).parent
CHECKOUT = SOURCES.parents[1]
FLAGS = ("-std=gnu11", "-O2", "-Wall", "-Wextra", "-Werror")


class CompileError(BusError):
    """The C programs cannot be compiled; the text is one line for the user."""


class CPrograms(NamedTuple):
    """The compiled programs; each source describes what its program does."""

    echo: Path
    requester: Path
    timer_loop: Path


def compile_all(folder: Path) -> CPrograms:
    """Compile every program into ``folder``; raises CompileError."""
    if shutil.which("gcc") is None:
        raise CompileError("the C programs to compare with need gcc (apt-get install gcc)")
    return CPrograms(*(_compile(name, folder) for name in CPrograms._fields))


def _compile(name: str, folder: Path) -> Path:
    source, program = SOURCES / f"{name}.c", folder / name
    command = ["gcc", *FLAGS, "-o", str(program), str(source)]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    if result.returncode:
        first = next((line for line in result.stderr.splitlines() if "error" in line), "")
        raise CompileError(f"gcc does not compile {source.name}: {first or result.stderr.strip()}")
    return program


ABOVE, BELOW = 10, -5
"""Priorities of the C loop and the requester, relative to the requested one."""
PRIORITY_MIN, PRIORITY_MAX = 1 - BELOW, 99 - ABOVE
GRACE_S = 60.0
"""A program is killed when it takes this much longer than its duration."""


class Role(NamedTuple):
    """A program, its priority of SCHED_FIFO, and the only processor it may run on.

    0 and None leave the choice to the program.
    """

    name: str
    command: Sequence[str]
    priority: int = 0
    cpu: int | None = None


@contextmanager
def started(role: Role, folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Run a program until the end of the block, which begins when it reports that it is ready."""
    with (folder / f"{role.name}.txt").open("wb") as complaints:
        process = subprocess.Popen(
            role.command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=complaints,
            env={**os.environ, "PYTHONPATH": str(CHECKOUT)},  # where benchmarks.bus is
            start_new_session=True,  # Ctrl-C reaches us alone, and we end them
        )
    with process:
        try:
            _wait_until_ready(role, process, folder)
            if role.cpu is not None:
                os.sched_setaffinity(process.pid, {role.cpu})
            if role.priority:
                os.sched_setscheduler(process.pid, os.SCHED_FIFO, os.sched_param(role.priority))
            yield process
        finally:
            process.kill()


def go(process: subprocess.Popen[bytes]) -> None:
    """Begin what a program has prepared."""
    assert process.stdin is not None  # noqa: S101 it is a pipe
    process.stdin.write(b"g")
    process.stdin.flush()


def finish(role: Role, process: subprocess.Popen[bytes], seconds: float, folder: Path) -> None:
    """Wait for the end of a program that takes ``seconds``; raises ProcessError if it fails."""
    try:
        status = process.wait(seconds + GRACE_S)
    except subprocess.TimeoutExpired as error:
        raise ProcessError(f"{role.name} does not end") from error
    if status:
        raise ProcessError(_complaint(role, folder) or f"{role.name} ended with status {status}")


def interrupt(role: Role, process: subprocess.Popen[bytes], folder: Path) -> None:
    """Ask a program to end, and wait for its report."""
    process.send_signal(signal.SIGINT)
    finish(role, process, 0.0, folder)


def python(module: str, *options: str) -> list[str]:
    """Return the command that runs a module that ends with this process, however that ends."""
    return [
        sys.executable,
        "-P",
        "-m",
        "steer_by_wire.closed_loop.processes.ends_with_parent",
        module,
        *options,
    ]


def _wait_until_ready(role: Role, process: subprocess.Popen[bytes], folder: Path) -> None:
    assert process.stdout is not None  # noqa: S101 it is a pipe
    for line in process.stdout:
        if b"ready" in line:
            return
    process.wait()
    raise ProcessError(_complaint(role, folder) or f"{role.name} has not started")


def _complaint(role: Role, folder: Path) -> str:
    printed = (folder / f"{role.name}.txt").read_text(encoding="utf-8", errors="replace")
    return (printed.strip().splitlines() or [""])[-1]


def may_have_priority() -> bool:
    """Whether the host grants SCHED_FIFO."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    except OSError:
        return False
    return True
