"""Many machines, through dask.distributed: the same blocks, the same results.

Workers need this package in the same version, and waypoint and trace files of the same names.
"""

import importlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import partial
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
    Workers,
    compute_block,
    payload_of,
)

CONNECT_S = 20.0


def _computed(
    client: Any, study: Study, address: str, blocks: Iterable[Block], should_stop: ShouldStop
) -> Iterator[Computed]:
    """Yield what the workers of a scheduler have done."""
    wait, payload, source = (
        importlib.import_module("distributed").wait,
        payload_of(study),
        iter(blocks),
    )
    waiting: set[Any] = set()
    while True:
        threads = max(1, sum(client.nthreads().values()))
        free = threads * WAITING_PER_WORKER - len(waiting)
        fresh = [] if should_stop() else islice(source, max(free, 0))
        waiting |= {client.submit(compute_block, payload, block, pure=False) for block in fresh}
        if not waiting:
            return
        try:
            done, waiting = wait(waiting, PATIENCE_S, "FIRST_COMPLETED")
        except TimeoutError:
            yield NOTHING
            continue
        for future in done:
            yield _result(future, address)


def _result(future: Any, address: str) -> Computed:
    """Return the result of a block; raises the worker's error, OSError if there is no result."""
    if future.status == "finished":
        computed: Computed = future.result()
        return computed
    error = future.exception() if future.status == "error" else None
    if isinstance(error, SettingsError):
        raise error
    reason = ": ".join([*getattr(error, "__notes__", ()), str(error or future.status)])
    raise OSError(f"the workers of {address} have failed: {reason}")


@contextmanager
def dask_workers(study: Study, address: str) -> Iterator[Workers]:
    """Join a scheduler until the block ends.

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
        compute = partial(_computed, client, study, address)
        yield Workers(f"the workers of {address}", compute)
