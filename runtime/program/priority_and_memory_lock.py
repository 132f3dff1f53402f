"""Real-time properties that a program requests of its host, and what the host grants.

No refusal is an error: it may make the program late at times, which the report shows.
"""

import ctypes
import gc
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

from ..command_line import whole_number
from ..exit_status import cause_of


@contextmanager
def no_collections() -> Iterator[None]:
    """Collect no garbage until the end of the block; nodes make no reference cycles."""
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_enabled:
            gc.enable()


_MCL_CURRENT, _MCL_FUTURE = 1, 2  # sys/mman.h
_PR_SET_TIMERSLACK = 29  # linux/prctl.h
priority = whole_number(0, 99)
"""Reads a priority of SCHED_FIFO (sched(7)), or 0."""


class HostAnswer(NamedTuple):
    """One request, whether it was granted, and details or the reason why not."""

    name: str
    got: bool
    detail: str


@contextmanager
def real_time(priority: int, *, lock_memory: bool = False) -> Iterator[list[HostAnswer]]:
    """Run the block in real time, as far as the host grants it; yields the answers.

    ``priority``  of SCHED_FIFO, 1 to 99, or 0 for the ordinary one

    Afterwards the program has its ordinary priority again, so that writing its report does not
    delay others. Memory lock and timer slack stay: they delay no one.
    """
    answers = [_timer_slack()]
    if lock_memory:
        answers.append(_locked_memory())
    gc.collect()
    gc.freeze()  # reference counting still frees all outside of cycles
    with no_collections():
        answers.append(HostAnswer("garbage collector", True, "frozen, off during the run"))
        fifo = _fifo(priority) if priority else None
        if fifo is not None:
            answers.append(fifo)
        try:
            yield answers
        finally:
            gc.unfreeze()
            if fifo is not None and fifo.got:
                os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def _fifo(priority: int) -> HostAnswer:
    name = "real-time priority"
    if sys.platform != "linux":
        return HostAnswer(name, False, "only on Linux")
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except (OSError, ValueError) as error:
        return HostAnswer(name, False, f"SCHED_FIFO {priority}: {cause_of(error)}")
    return HostAnswer(name, True, f"SCHED_FIFO {priority}")


def _locked_memory() -> HostAnswer:
    name = "memory lock"
    # Under a limit, locking future pages too would make allocations fail during the run.
    limited = _lock_limit_bytes() is not None
    detail = _call_libc("mlockall", _MCL_CURRENT if limited else _MCL_CURRENT | _MCL_FUTURE)
    got = "no page of the start" if limited else "no page"
    return HostAnswer(name, not detail, detail or f"{got} leaves the memory")


def _lock_limit_bytes() -> int | None:
    """Return how much memory may be locked [bytes]; None without limit, as for root."""
    if sys.platform != "linux" or os.geteuid() == 0:
        return None
    import resource  # only Unix has it

    limit = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
    return None if limit == resource.RLIM_INFINITY else limit


def _timer_slack() -> HostAnswer:
    """Request precise wake-ups; by default Linux may add 50 µs to save power."""
    detail = _call_libc("prctl", _PR_SET_TIMERSLACK, 1, 0, 0, 0)
    return HostAnswer("timer slack", not detail, detail or "1 ns")


def _call_libc(function: str, *arguments: int) -> str:
    if sys.platform != "linux":
        return "only on Linux"
    call = getattr(ctypes.CDLL(None, use_errno=True), function)
    if call(*(ctypes.c_ulong(argument) for argument in arguments)) == 0:
        return ""
    return os.strerror(ctypes.get_errno())
