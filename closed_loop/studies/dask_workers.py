"""Many machines, through dask.distributed: the same blocks, the same results.

Workers need this package in the same version, and waypoint and trace files of the same names.
"""

import importlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from itertools import islice
from typing import Any

from ...runtime.command_line import installation
from ...runtime.settings import SettingsError
from .compiled_runs import Computed
from .study import Study
from .workers import (
    NOTHING,
    PATIENCE_S,
    WAITING_PER_WORKER,
    Block,
    ShouldStop,
    compute_block,
    payload_of,
)

CONNECT_S = 20.0


class DaskWorkers:
    """Workers of a scheduler; ``say`` is told in one line when one is lost or comes."""

    def __init__(
        self, client: Any, study: Study, description: str, say: Callable[[str], None]
    ) -> None:
        self._client = client
        self._payload = payload_of(study)
        self._wait = importlib.import_module("distributed").wait
        self._say = say
        self._known: int | None = None
        self.description = description

    def threads(self) -> int:
        """Return how many blocks they compute at the same time; say which workers went or came."""
        threads: dict[str, int] = self._client.nthreads()
        before, now = self._known, len(threads)
        self._known = now
        if now == 0 and before != 0:
            self._say("no worker is there: waiting for one; Ctrl-C keeps what is computed")
        elif before is not None and now < before:
            self._say(f"lost {before - now} of {before} workers: the others repeat what was lost")
        elif before is not None and now > before:
            self._say(f"workers: {now}, {now - before} more than before")
        return max(1, sum(threads.values()))

    def compute(self, blocks: Iterable[Block], should_stop: ShouldStop) -> Iterator[Computed]:
        """Yield what is done."""
        source = iter(blocks)
        waiting: set[Any] = set()
        while True:
            free = self.threads() * WAITING_PER_WORKER - len(waiting)
            fresh = [] if should_stop() else islice(source, max(free, 0))
            waiting |= {
                self._client.submit(compute_block, self._payload, block, pure=False)
                for block in fresh
            }
            if not waiting:
                return
            try:
                done, waiting = self._wait(waiting, PATIENCE_S, "FIRST_COMPLETED")
            except TimeoutError:
                yield NOTHING
                continue
            for future in done:
                yield self._result(future)

    def _result(self, future: Any) -> Computed:
        """Return the result of a block; raises the worker's error, OSError if there is no
        result."""
        if future.status == "finished":
            computed: Computed = future.result()
            return computed
        error = future.exception() if future.status == "error" else None
        if isinstance(error, SettingsError):
            raise error
        reason = ": ".join([*getattr(error, "__notes__", ()), str(error or future.status)])
        raise OSError(f"{self.description} have failed: {reason}")


@contextmanager
def dask_workers(study: Study, address: str, say: Callable[[str], None]) -> Iterator[DaskWorkers]:
    """Join a scheduler until the block ends; ``say`` as for ``DaskWorkers``.

    Raises SettingsError where distributed is missing or no scheduler answers.
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
    with client:
        yield DaskWorkers(client, study, f"the workers of {address}", say)
