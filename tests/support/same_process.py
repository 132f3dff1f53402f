"""Worker processes that are none, for tests of a program that assert nothing about its workers.

A process of its own imports for a second. One test of each kind of work does without this.
"""

from collections.abc import Callable
from concurrent.futures import Executor, Future
from typing import Any

import pytest

from steer_by_wire import worker_processes


class _SameProcess(Executor):
    def __init__(self, _workers: int, _context: object, _begin: object, begin: Any) -> None:
        if begin[0] is not None:
            begin[0](*begin[1])

    def submit(self, work: Callable[..., Any], /, *words: Any, **further: Any) -> Future[Any]:
        future: Future[Any] = Future()
        try:
            future.set_result(work(*words, **further))
        except Exception as error:
            future.set_exception(error)
        return future


@pytest.fixture
def same_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have what is submitted to worker processes done at once in this one."""
    monkeypatch.setattr(worker_processes, "_Pool", _SameProcess)
