"""Worker processes that are none, for tests of a program that assert nothing about its workers.

A process of its own imports for a second. Work and result go through the bytes that they would
cross between two processes as. One test of each kind of work does without this.
"""

import pickle
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from typing import Any

import pytest

from steer_by_wire.closed_loop.processes import parallel_work


class _SameProcess(Executor):
    def __init__(self, _workers: int, _context: object, _begin: object) -> None:
        pass

    def submit(self, work: Callable[..., Any], /, *words: Any, **further: Any) -> Future[Any]:
        future: Future[Any] = Future()
        try:
            work, words, further = _crossed((work, words, further))
            future.set_result(_crossed(work(*words, **further)))
        except Exception as error:
            future.set_exception(error)
        return future


def _crossed(content: Any) -> Any:
    return pickle.loads(pickle.dumps(content))  # noqa: S301  # our own


@contextmanager
def no_workers() -> Iterator[None]:
    """Have what is submitted to worker processes done at once in this one, during the block."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(parallel_work, "_Pool", _SameProcess)
        yield


@pytest.fixture
def same_process() -> Iterator[None]:
    """Have the same during a test."""
    with no_workers():
        yield
