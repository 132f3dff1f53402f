"""Workers that compute the runs of a study: threads, or processes of this machine or of others.

Threads serve compiled runs, which do not hold the interpreter's lock; processes the others. A
process is sent the record of a study, makes the study from it, and keeps what runs share, as a
thread does.
"""

import importlib
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from functools import lru_cache, partial
from itertools import islice
from typing import NamedTuple

from ...runtime.command_line import installation
from ...runtime.settings import SettingsError
from ..processes.parallel_work import worker_pool
from .compiled_runs import Computed, Computer
from .scenario import Scenarios
from .study import Study, study_of_record

CONNECT_S = 20.0


def compute_block(file: str, record: str, ids: Sequence[int]) -> Computed:
    """Compute runs of the study of a record, which its ``file`` has in messages."""
    return _computer(file, record).compute(ids, lambda: False)


@lru_cache(maxsize=2)
def _computer(file: str, record: str) -> Computer:
    return Computer(Scenarios(study_of_record(file, record)))


WAITING_PER_WORKER = 3
"""Blocks in progress for each worker: memory stays bounded, and no worker idles."""
PATIENCE_S = 0.25
"""Longest wait for a block before checking whether to stop."""

Block = list[int]
ShouldStop = Callable[[], bool]


class Workers(NamedTuple):
    """What computes blocks of ids, in any order.

    ``compute``      yields completed blocks; none computed is lost on a stop
    """

    description: str
    compute: Callable[[Iterable[Block], ShouldStop], Iterator[Computed]]


def thread_workers(scenarios: Scenarios, count: int) -> Workers:
    """Return threads of this process."""
    computer = Computer(scenarios)

    def compute(blocks: Iterable[Block], should_stop: ShouldStop) -> Iterator[Computed]:
        task = partial(computer.compute, should_stop=should_stop)
        with ThreadPoolExecutor(count, thread_name_prefix="study") as pool:
            yield from completed(pool, task, lambda: count, blocks, should_stop)

    return Workers(f"{count} thread{'s' if count > 1 else ''}", compute)


def block_task(study: Study) -> Callable[[Block], Computed]:
    """Return what computes a block of a study in another process."""
    return partial(compute_block, study.file, study.record)


def local_workers(scenarios: Scenarios, count: int | None) -> Workers:
    """Return processes for runs over a bus, threads for others; by default one per processor.

    On a stop processes finish the runs that they have begun.
    """
    count = min(count or os.cpu_count() or 1, scenarios.study.runs)
    if not scenarios.study.on_nodes or count == 1:
        return thread_workers(scenarios, count)
    task = block_task(scenarios.study)

    def compute(blocks: Iterable[Block], should_stop: ShouldStop) -> Iterator[Computed]:
        with worker_pool(count) as pool:
            yield from completed(pool, task, lambda: count, blocks, should_stop)

    return Workers(f"{count} processes", compute)


def completed(
    pool: Executor,
    task: Callable[[Block], Computed],
    count: Callable[[], int],
    blocks: Iterable[Block],
    should_stop: ShouldStop,
) -> Iterator[Computed]:
    """Yield what ``task`` makes of the blocks; raises its first error when the others are done.

    ``count``  returns how many workers there are
    """
    source = iter(blocks)
    failed: list[BaseException] = []
    waiting: set[Future[Computed]] = set()
    while True:
        if failed or should_stop():
            waiting = {future for future in waiting if not future.cancel()}
        else:
            free = max(0, count() * WAITING_PER_WORKER - len(waiting))
            waiting |= {pool.submit(task, block) for block in islice(source, free)}
        if not waiting:
            break
        done, waiting = wait(waiting, PATIENCE_S, FIRST_COMPLETED)
        for future in done:
            error = future.exception()
            if error is not None:
                failed.append(error)
            else:
                yield future.result()
    if failed:
        raise failed[0]


@contextmanager
def dask_workers(study: Study, address: str) -> Iterator[Workers]:
    """Join a scheduler of dask.distributed until the block ends: the same blocks on many machines.

    Its workers need this package in the same version, and waypoint and trace files of the same
    names.

    Raises SettingsError where distributed is missing or no scheduler answers, OSError where the
    workers fail.
    """
    try:
        distributed = importlib.import_module("distributed")
    except ImportError as error:
        needed = installation("pyarrow", "distributed")
        raise SettingsError(f"--scheduler needs dask.distributed: {needed}") from error
    try:
        client = distributed.Client(address, timeout=CONNECT_S)
    except (OSError, ValueError) as error:
        raise SettingsError(f"--scheduler {address}: no scheduler answers there") from error

    def threads() -> int:
        count: int = sum(client.nthreads().values())
        return max(1, count)

    def compute(blocks: Iterable[Block], should_stop: ShouldStop) -> Iterator[Computed]:
        pool = client.get_executor(pure=False)
        try:
            yield from completed(pool, block_task(study), threads, blocks, should_stop)
        except SettingsError:
            raise
        except Exception as error:
            reason = ": ".join([*getattr(error, "__notes__", ()), str(error)])
            raise OSError(f"the workers of {address} have failed: {reason}") from error

    with client:
        yield Workers(f"the workers of {address}", compute)
