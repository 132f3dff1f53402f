"""Workers that compute the runs of a study: threads, or processes of this machine.

Threads serve compiled runs, which do not hold the interpreter's lock; processes the others. A
process is sent a study as text, makes the study from it, and keeps what runs share, as a thread
does.
"""

import json
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from functools import lru_cache, partial
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..processes.parallel_work import worker_pool
from .compiled_runs import Computed, Computer
from .factors import make_design
from .scenario import Scenarios
from .study import Study, study_factors
from .study_file import StudySettings


def compute_block(payload: str, ids: Sequence[int]) -> Computed:
    """Compute runs of the study that ``payload_of`` has described."""
    return _computer(payload).compute(ids, lambda: False)


@lru_cache(maxsize=2)
def _computer(payload: str) -> Computer:
    study = json.loads(payload)
    settings = StudySettings.model_validate_json(json.dumps(study["settings"]))
    design = make_design(study_factors(settings, study["file"]), settings.sampling)
    tables = study["plant"], study["controllers"]
    made = Study(study["file"], settings, *tables, design, study["bus"])
    made = made._replace(dialect=study["dialect"])
    return Computer(Scenarios(made))


def payload_of(study: Study) -> str:
    """Return a study as text, from which another process makes it again."""
    return json.dumps(
        {
            "file": str(Path(study.file).name),
            "settings": study.settings.model_dump(mode="json", exclude_none=True),
            "plant": study.plant,
            "controllers": study.controllers,
            "bus": study.bus,
            "dialect": study.dialect,
        }
    )


WAITING_PER_WORKER = 3
"""Blocks in progress for each worker: memory stays bounded, and no worker idles."""
PATIENCE_S = 0.25
"""Longest wait for a block before checking whether to stop."""

Block = list[int]
ShouldStop = Callable[[], bool]


class Workers(NamedTuple):
    """What computes blocks of ids, in any order.

    ``description``  in a few words
    ``compute``      yields completed blocks; none computed is lost on a stop. An empty one now and
                     then lets the caller act
    """

    description: str
    compute: Callable[[Iterable[Block], ShouldStop], Iterator[Computed]]


def thread_workers(scenarios: Scenarios, count: int) -> Workers:
    """Return threads of this process."""
    computer = Computer(scenarios)

    def compute(blocks: Iterable[Block], should_stop: ShouldStop) -> Iterator[Computed]:
        task = partial(computer.compute, should_stop=should_stop)
        with ThreadPoolExecutor(count, thread_name_prefix="study") as pool:
            yield from _completed(pool, task, count, blocks, should_stop)

    return Workers(f"{count} thread{'s' if count > 1 else ''}", compute)


def process_workers(study: Study, count: int) -> Workers:
    """Return processes of this machine; on a stop they finish the runs that they have begun."""
    task = partial(compute_block, payload_of(study))

    def compute(blocks: Iterable[Block], should_stop: ShouldStop) -> Iterator[Computed]:
        with worker_pool(count) as pool:
            yield from _completed(pool, task, count, blocks, should_stop)

    return Workers(f"{count} processes", compute)


def local_workers(scenarios: Scenarios, count: int | None) -> Workers:
    """Return processes for runs over a bus, threads for others; by default one per processor."""
    count = min(count or os.cpu_count() or 1, scenarios.study.runs)
    if scenarios.study.bus is not None and count > 1:
        return process_workers(scenarios.study, count)
    return thread_workers(scenarios, count)


def _completed(
    pool: Executor,
    task: Callable[[Block], Computed],
    count: int,
    blocks: Iterable[Block],
    should_stop: ShouldStop,
) -> Iterator[Computed]:
    """Yield what ``task`` makes of the blocks; raises its first error when the others are done."""
    source = iter(blocks)
    failed: list[BaseException] = []
    waiting: set[Future[Computed]] = set()
    while True:
        if failed or should_stop():
            waiting = {future for future in waiting if not future.cancel()}
        else:
            free = count * WAITING_PER_WORKER - len(waiting)
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
        if not done:
            yield NOTHING
    if failed:
        raise failed[0]


NOTHING = Computed(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros((0, 0)))
