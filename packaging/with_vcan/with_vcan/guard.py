"""A process between the wrapper and the command that lets nothing outlive either of them.

    wrapper ──lifeline──► guard ──► command or User Mode Linux ──► whatever these start

The guard adopts every orphan below it (PR_SET_CHILD_SUBREAPER), so it can find and kill them all.
It does so when the command has ended, on request, and when the wrapper has ended in any way: the
lifeline is a pipe that closes with the wrapper. Bytes on it are signals for the command.
"""

import os
import select
import signal
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple, NoReturn

from .system_calls import adopt_orphans, die_with_parent, signal_descriptor

KILLED_STATUS = 128 + signal.SIGKILL
NOT_EXECUTABLE_STATUS, NOT_FOUND_STATUS = 126, 127
"""Exit statuses as in a shell."""
_BETWEEN_KILLS_S = 0.005
_END = 0
"""On the lifeline: kill everything. No signal has this number."""


class Guard(NamedTuple):
    """A running guard: its process, and the wrapper's end of the lifeline."""

    pid: int
    lifeline: int

    def send(self, number: int) -> None:
        """Send the command a signal."""
        with suppress(BrokenPipeError):
            os.write(self.lifeline, bytes([number]))

    def end(self) -> None:
        """Kill everything; may be called again."""
        self.send(_END)


class Launch(NamedTuple):
    """What a guard starts.

    ``run``          called in the new process; does not return
    ``descriptors``  held by the new process only
    ``clean``        called when everything has ended
    """

    run: Callable[[], NoReturn]
    descriptors: Sequence[int] = ()
    clean: Callable[[], None] = lambda: None


def start_guard(launch: Launch) -> Guard:
    """Start a guard; signals that the caller has blocked stay blocked in it, not in the command."""
    read_end, write_end = os.pipe()
    pid = os.fork()
    if pid == 0:
        os.close(write_end)
        status = KILLED_STATUS
        try:
            status = _guard(launch, read_end)
        except BaseException:  # no exception may leave a forked process
            traceback.print_exc()
        finally:
            os._exit(status)
    for descriptor in (read_end, *launch.descriptors):
        os.close(descriptor)
    return Guard(pid, write_end)


def exit_status(wait_status: int) -> int:
    """Return a process's exit status as a shell reports it."""
    code = os.waitstatus_to_exitcode(wait_status)
    return code if code >= 0 else 128 - code


def execute(command: Sequence[str], environment: dict[str, str]) -> NoReturn:
    """Become ``command``, as if started from a shell; never returns."""
    for number in (signal.SIGPIPE, signal.SIGXFSZ):
        signal.signal(number, signal.SIG_DFL)  # Python ignores them, and that is inherited
    signal.pthread_sigmask(signal.SIG_SETMASK, ())
    try:
        os.execvpe(command[0], list(command), environment)  # noqa: S606 it is what we are for
    except OSError as error:
        print(f"with-vcan: error: {command[0]}: {error.strerror}", file=sys.stderr, flush=True)
        absent = isinstance(error, FileNotFoundError)
        os._exit(NOT_FOUND_STATUS if absent else NOT_EXECUTABLE_STATUS)


def _guard(launch: Launch, lifeline: int) -> int:
    """Start the child, watch it and the lifeline; returns the child's exit status."""
    adopt_orphans()
    child_ends = signal_descriptor([signal.SIGCHLD])
    guard = os.getpid()
    child = os.fork()
    if child == 0:
        die_with_parent()
        if os.getppid() != guard:
            os._exit(KILLED_STATUS)  # the parent had ended before die_with_parent()
        launch.run()
    for descriptor in launch.descriptors:
        os.close(descriptor)
    status = None
    while status is None:
        ready, _, _ = select.select([lifeline, child_ends], [], [])
        if lifeline in ready:
            numbers = os.read(lifeline, 64)
            if not numbers or _END in numbers:
                break
            for number in numbers:
                os.kill(child, number)
        if child_ends in ready:
            os.read(child_ends, 4096)
            status = reap().get(child)
    _kill_descendants()
    launch.clean()
    return KILLED_STATUS if status is None else status


def reap() -> dict[int, int]:
    """Return the exit statuses of the children that have ended since the last call."""
    ended: dict[int, int] = {}
    with suppress(ChildProcessError):
        while True:
            pid, status = os.waitpid(-1, os.WNOHANG)
            if pid == 0:
                break
            # User Mode Linux traces its processes; if the tracer was killed, one reads as stopped.
            if not os.WIFSTOPPED(status):
                ended[pid] = exit_status(status)
    return ended


def _kill_descendants() -> None:
    """Kill until no descendant is left: each may just have started another one."""
    while found := descendants(os.getpid()):
        for pid in found:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        reap()
        time.sleep(_BETWEEN_KILLS_S)
    reap()


def descendants(ancestor: int) -> list[int]:
    """Return every living process that ``ancestor`` or a descendant of it has started."""
    children: dict[int, list[int]] = {}
    dead = set()
    for folder in Path("/proc").iterdir():
        if not folder.name.isdecimal():
            continue
        with suppress(OSError):
            # The name in front of these fields is in parentheses and may hold anything.
            state, parent, *_ = (folder / "stat").read_text().rpartition(")")[2].split()
            children.setdefault(int(parent), []).append(int(folder.name))
            if state in "ZX":
                dead.add(int(folder.name))
    found: list[int] = []
    waiting = [ancestor]
    while waiting:
        below = children.get(waiting.pop(), [])
        found += below
        waiting += below
    return [pid for pid in found if pid not in dead]
