"""Worker processes: the one way in which the tools share out what they compute."""

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from threading import Thread
from typing import Any

_ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
"""Workers whose matrices spread over the same processors wait for each other most of the time."""


class _Pool(ProcessPoolExecutor):
    """Starts its processes, which it does when work comes, while Ctrl-C waits."""

    def submit(self, *work: Any, **further: Any) -> Future[Any]:
        with _ctrl_c_held():
            return super().submit(*work, **further)


@contextmanager
def worker_pool(
    workers: int, begin: Callable[..., None] | None = None, *told: Any
) -> Iterator[ProcessPoolExecutor]:
    """Open worker processes, which call ``begin(*told)`` first.

    An exception, Ctrl-C among them, ends them at once instead of waiting for what they do. They
    leave Ctrl-C, which every process of a terminal gets, to this process, and end when it is gone,
    however it was ended.
    """
    os.environ.update(_ONE_THREAD)
    others = set(multiprocessing.active_children())
    # A fork of a process with threads may hang; spawned ones read the modules once.
    context = multiprocessing.get_context("spawn")
    pool = _Pool(workers, context, _begin, (begin, told))
    try:
        yield pool
    except BaseException:
        with _ctrl_c_held():  # a second one would leave processes that nobody ends
            pool.shutdown(wait=False, cancel_futures=True)
            for child in set(multiprocessing.active_children()) - others:
                child.terminate()
        raise
    pool.shutdown()


def _begin(begin: Callable[..., None] | None, told: tuple[Any, ...]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    Thread(target=_end_with_parent, daemon=True).start()
    if begin is not None:
        begin(*told)


def _end_with_parent() -> None:
    """Wait for the end of the parent: the queue of work has no end that a worker could notice."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextmanager
def _ctrl_c_held() -> Iterator[None]:
    """Let Ctrl-C wait; what is started meanwhile leaves it alone before it can get it."""
    if not hasattr(signal, "pthread_sigmask"):  # as on Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
