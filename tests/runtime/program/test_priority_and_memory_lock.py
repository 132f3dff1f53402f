"""Requests to the host for priority and memory lock, and its answers.

The host is a fake, so that no test locks its own process into memory or starves the others.
"""

import ctypes
import gc
import os
import resource
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager

import pytest

from steer_by_wire.runtime.program.priority_and_memory_lock import HostAnswer, real_time


def everything() -> AbstractContextManager[list[HostAnswer]]:
    return real_time(50, lock_memory=True)


class Linux:
    """A made-up Linux that notes what it is asked for, and refuses when ``error`` is set."""

    def __init__(self) -> None:
        self.error = 0
        self.calls: list[tuple[object, ...]] = []
        self.policy = os.SCHED_OTHER
        self.user = 0  # root

    def mlockall(self, flags: object) -> int:
        return self._libc("mlockall", flags)

    def prctl(self, option: object, *values: object) -> int:
        return self._libc("prctl", option, *values)

    def sched_setscheduler(self, pid: int, policy: int, parameters: os.sched_param) -> None:
        self._system("scheduler", pid, policy, parameters.sched_priority)
        self.policy = policy

    def sched_getscheduler(self, _pid: int) -> int:
        return self.policy

    def _system(self, *call: object) -> None:
        self.calls.append(call)
        if self.error:
            raise OSError(self.error, os.strerror(self.error))

    def _libc(self, name: str, *arguments: object) -> int:
        values = [getattr(argument, "value", argument) for argument in arguments]
        self.calls.append((name, *values))
        return -1 if self.error else 0


@pytest.fixture
def linux(monkeypatch: pytest.MonkeyPatch) -> Linux:
    linux = Linux()
    monkeypatch.setattr(sys, "platform", "linux")
    for name in ("sched_setscheduler", "sched_getscheduler"):
        monkeypatch.setattr(os, name, getattr(linux, name))
    monkeypatch.setattr(os, "geteuid", lambda: linux.user)
    monkeypatch.setattr(ctypes, "CDLL", lambda *_, **__: linux)
    monkeypatch.setattr(ctypes, "get_errno", lambda: linux.error)
    return linux


@pytest.fixture(autouse=True)
def _garbage_collector() -> Iterator[None]:
    yield
    gc.enable()


def by_name(answers: list[HostAnswer]) -> dict[str, HostAnswer]:
    return {answer.name: answer for answer in answers}


def test_what_is_granted_is_reported_as_got(linux: Linux) -> None:
    with everything() as answers:
        assert all(answer.got for answer in answers)
        assert {answer.name: answer.detail for answer in answers} == {
            "timer slack": "1 ns",
            "memory lock": "no page leaves the memory",
            "garbage collector": "frozen, off during the run",
            "real-time priority": "SCHED_FIFO 50",
        }
    assert ("prctl", 29, 1, 0, 0, 0) in linux.calls
    assert ("mlockall", 3) in linux.calls
    assert ("scheduler", 0, os.SCHED_FIFO, 50) in linux.calls


def test_under_a_limit_only_the_memory_in_use_is_locked(
    linux: Linux, monkeypatch: pytest.MonkeyPatch
) -> None:
    linux.user = 1000
    monkeypatch.setattr(resource, "getrlimit", lambda _: (8 << 20, 8 << 20))
    with everything() as answers:
        assert by_name(answers)["memory lock"].detail == "no page of the start leaves the memory"
    assert ("mlockall", 1) in linux.calls


def test_what_is_refused_is_reported_with_the_reason_and_the_block_runs(linux: Linux) -> None:
    linux.error = 1
    with everything() as answers:
        refused = {name: a.detail for name, a in by_name(answers).items() if not a.got}
    assert set(refused) == {"timer slack", "memory lock", "real-time priority"}
    assert all(os.strerror(1) in detail for detail in refused.values())


def test_elsewhere_everything_is_refused_by_name(
    linux: Linux, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "platform", "darwin")
    with everything() as answers:
        refused = {name: a.detail for name, a in by_name(answers).items() if not a.got}
    assert set(refused.values()) == {"only on Linux"}
    assert len(refused) == 3
    assert linux.calls == []


@pytest.mark.parametrize("error", [None, KeyError("from the run")])
def test_the_program_is_an_ordinary_one_again_however_the_block_ends(
    linux: Linux, error: Exception | None
) -> None:
    try:
        with everything():
            assert linux.policy == os.SCHED_FIFO
            if error is not None:
                raise error
    except KeyError:
        assert error is not None
    assert linux.policy == os.SCHED_OTHER
    assert gc.isenabled()
