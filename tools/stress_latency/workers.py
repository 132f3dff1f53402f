"""Threads over scenarios: the compiled loop does not hold the interpreter's lock."""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from itertools import islice
from typing import Protocol

from ...studies.compute import Computed, Computer
from ...studies.scenario import Scenarios

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

    @property
    def description(self) -> str:
        """What they are, in a few words."""
        return f"{self.count} thread{'s' if self.count > 1 else ''}"

    def compute(self, blocks: Iterable[Block], should_stop: ShouldStop) -> Iterator[Computed]:
        """Yield completed blocks."""
        failed: list[BaseException] = []

        def stops() -> bool:
            return bool(failed) or should_stop()

        with ThreadPoolExecutor(self.count, thread_name_prefix="stress") as pool:
            source = iter(blocks)
            waiting: set[Future[Computed]] = set()
            while True:
                free = self.count * WAITING_PER_WORKER - len(waiting)
                fresh = [] if stops() else islice(source, free)
                waiting |= {pool.submit(self._computer.compute, block, stops) for block in fresh}
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


def _nothing() -> Computed:
    import numpy as np

    return Computed(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros((0, 0)))


NOTHING = _nothing()
