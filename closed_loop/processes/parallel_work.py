"""Worker processes: the one way in which the tools distribute computations."""

import multiprocessing
import os
import signal
from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from threading import Thread
from typing import Any

from ...runtime.exit_status import UserError

_ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
"""Limits numerical libraries to one thread: workers would wait for each other's threads."""


class _Pool(ProcessPoolExecutor):
    """Starts its processes, when work is submitted, with Ctrl-C held back."""

    def submit(self, *work: Any, **further: Any) -> Future[Any]:
        with _ctrl_c_held():
            return super().submit(*work, **further)


@contextmanager
def worker_pool(workers: int) -> Iterator[ProcessPoolExecutor]:
    """Open worker processes.

    An exception in the block, Ctrl-C included, ends them at once without waiting for their work.
    A worker that ended before is a UserError.
    Ctrl-C reaches every process of a terminal; the workers leave it to this process. They end when
    this process has ended, however it ended.
    """
    others = set(multiprocessing.active_children())
    # A fork of a process with threads may hang; spawned processes import the modules once.
    context = multiprocessing.get_context("spawn")
    pool = _Pool(workers, context, _begin)
    try:
        with _one_thread():
            yield pool
    except BaseException as error:
        with _ctrl_c_held():  # a second Ctrl-C would leave processes running
            pool.shutdown(wait=False, cancel_futures=True)
            for child in set(multiprocessing.active_children()) - others:
                child.terminate()
        if isinstance(error, BrokenProcessPool):
            raise UserError(
                "a worker process was ended from outside (by a signal, or for want of memory):"
                " run again, with fewer workers or more memory"
            ) from error
        raise
    pool.shutdown()


@contextmanager
def _one_thread() -> Iterator[None]:
    """Limit the processes that the block starts, and leave the environment as it was."""
    before = {name: os.environ[name] for name in _ONE_THREAD if name in os.environ}
    os.environ.update(_ONE_THREAD)
    try:
        yield
    finally:
        for name in _ONE_THREAD.keys() - before.keys():
            del os.environ[name]
        os.environ.update(before)


def _begin() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End with the parent: a worker that waits for work does not notice the parent's end."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextmanager
def _ctrl_c_held() -> Iterator[None]:
    """Hold Ctrl-C back; processes started meanwhile ignore it before it can reach them."""
    if not hasattr(signal, "pthread_sigmask"):  # as on Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
