"""Runs the missing part of a study, until it is complete or stopped.

Threads serve compiled runs, which do not hold the interpreter's lock; processes the others. A
process is sent a study as text. It makes the study from its settings by itself and keeps what runs
share, as a thread does.
"""

import json
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from functools import lru_cache, partial
from itertools import chain, islice
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np

from ...controller.laws.design import design_law
from ..worker_processes import worker_pool
from .compute import Computed, Computer
from .sampling import make_design
from .scenario import Scenarios
from .store import Store
from .study import Study, study_factors
from .study_file import StudySettings


def compute_block(payload: str, ids: Sequence[int]) -> Computed:
    """Compute runs of the study that ``payload_of`` has described."""
    return _computer(payload).compute(ids, _never)


@lru_cache(maxsize=2)
def _computer(payload: str) -> Computer:
    study = json.loads(payload)
    settings = StudySettings.model_validate_json(json.dumps(study["settings"]))
    design = make_design(study_factors(settings, study["file"]), settings.sampling)
    tables = study["plant"], study["controllers"]
    made = Study(study["file"], settings, *tables, design, study["fastmath"], study["bus"])
    return Computer(Scenarios(made))


def payload_of(study: Study) -> str:
    """Return a study as text, from which another process makes it again."""
    return json.dumps(
        {
            "file": str(Path(study.file).name),
            "settings": study.settings.model_dump(mode="json", exclude_none=True),
            "plant": study.plant,
            "controllers": study.controllers,
            "fastmath": study.fastmath,
            "bus": study.bus,
        }
    )


WAITING_PER_WORKER = 3
"""Blocks in progress for each worker: memory stays bounded, and no worker idles."""
PATIENCE_S = 0.25
"""Longest wait for a block before checking whether to stop."""

Block = list[int]
ShouldStop = Callable[[], bool]


class Workers(Protocol):
    """Compute blocks of ids, in any order."""

    @property
    def description(self) -> str:
        """What they are, in a few words."""
        ...

    @property
    def count(self) -> int:
        """How many compute at the same time."""
        ...

    def compute(self, blocks: Iterable[Block], should_stop: ShouldStop) -> Iterator[Computed]:
        """Yield completed blocks; none computed is lost on a stop. An empty one now and then lets
        the caller act.
        """
        ...


class Threads:
    """Threads of this process."""

    def __init__(self, scenarios: Scenarios, count: int) -> None:
        self._computer = Computer(scenarios)
        self.count = count
        self.description = f"{count} thread{'s' if count > 1 else ''}"

    def compute(self, blocks: Iterable[Block], should_stop: ShouldStop) -> Iterator[Computed]:
        """Yield completed blocks."""
        task = partial(self._computer.compute, should_stop=should_stop)
        with ThreadPoolExecutor(self.count, thread_name_prefix="stress") as pool:
            yield from _completed(pool, task, self.count, blocks, should_stop)


class Processes:
    """Processes of this machine; on a stop they finish the runs that they have begun."""

    def __init__(self, study: Study, count: int) -> None:
        self._payload = payload_of(study)
        self.count = count
        self.description = f"{count} processes"

    def compute(self, blocks: Iterable[Block], should_stop: ShouldStop) -> Iterator[Computed]:
        """Yield completed blocks."""
        task = partial(compute_block, self._payload)
        with worker_pool(self.count) as pool:
            yield from _completed(pool, task, self.count, blocks, should_stop)


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

BLOCK_RUNS = 64
"""Compiled runs handed to a worker at once: some tens of milliseconds. One over a bus takes longer
than all of them."""
FLUSH_S = 10.0
"""Interval at which an incomplete chunk is written: the most that a crash can lose."""
KINDS_OF = 200
"""Controllers searched for kinds of laws that an estimate has not compiled yet."""
TRIALS_MAX, TRIAL_RUNS, TRIALS_S = 16, 160, 3.0
"""Stretches, runs in each, and longest time of an estimate."""


class Estimate(NamedTuple):
    """How long runs take, from a few that were measured.

    ``seconds_a_run``  on one thread, the network shared as in the study
    """

    runs: int
    seconds_a_run: float


def run_study(
    store: Store, workers: Workers, on_progress: Callable[[int], None], should_stop: ShouldStop
) -> bool:
    """Compute and store what is missing; returns whether the study is complete.

    ``on_progress``  called with how many further runs are done

    Computed runs are stored however it ends.
    """
    if store.is_complete:
        return True
    flushed_s = time.monotonic()
    try:
        block_runs = BLOCK_RUNS if store.scenarios.study.bus is None else 1
        for computed in workers.compute(_blocks(store.missing(), block_runs), should_stop):
            if len(computed.ids):
                store.put(computed)
                on_progress(len(computed.ids))
            if time.monotonic() - flushed_s >= FLUSH_S:
                store.flush()
                flushed_s = time.monotonic()
    finally:
        store.flush()
    if should_stop() and next(store.missing(), None):
        return False
    store.finish()
    return True


def estimate(scenarios: Scenarios, clock_s: Callable[[], float] = time.perf_counter) -> Estimate:
    """Measure a few stretches of the study, in which runs share what they share in the study."""
    computer = Computer(scenarios)
    runs = scenarios.study.runs
    # The golden ratio spreads any number of places evenly.
    places = [0.618033988749895 * (place + 1) % 1.0 for place in range(TRIALS_MAX)]
    firsts = [int(max(runs - TRIAL_RUNS, 0) * place) for place in places]
    stretches = [range(first, min(first + TRIAL_RUNS, runs)) for first in firsts]
    # The first run of each kind of law compiles, and is not counted.
    computer.compute(_one_of_each_kind(scenarios, stretches), _never)
    begin_s = clock_s()
    done = 0
    for ids in stretches:
        block = list(ids if scenarios.study.bus is None else ids[:1])
        computer.compute(block, _never)
        done += len(block)
        if clock_s() - begin_s > TRIALS_S or done >= runs:
            break
    return Estimate(done, (clock_s() - begin_s) / done)


def _one_of_each_kind(scenarios: Scenarios, stretches: Sequence[range]) -> list[int]:
    """Return a run of each kind of parameters a law may have: one is compiled for each."""
    kinds: dict[object, int] = {}
    seen: set[int] = set()
    for run in chain.from_iterable(stretches):
        index, place = divmod(run, len(scenarios.controllers))
        controller = scenarios.controller(scenarios.case(index), scenarios.controllers[place])
        if id(controller) not in seen and len(seen) < KINDS_OF:
            seen.add(id(controller))
            kinds.setdefault(_kind(design_law(controller).params), run)
    return sorted(kinds.values())


def _kind(params: object) -> object:
    """Return the types of nested parameters, as the compiler sees them."""
    if isinstance(params, tuple):
        return (type(params), *map(_kind, params))
    return type(params)


def _blocks(chunks: Iterable[list[int]], block_runs: int) -> Iterator[Block]:
    for ids in chunks:
        for first in range(0, len(ids), block_runs):
            yield ids[first : first + block_runs]


def _never() -> bool:
    return False
