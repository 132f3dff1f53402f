"""Many machines, through dask.distributed: the same blocks, the same results.

Workers need this package in the same version, and waypoint and trace files of the same names.
"""

import importlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from ...runtime.command_line import installation
from ...runtime.settings import SettingsError
from .compiled_runs import Computed
from .study import Study
from .workers import Block, ShouldStop, Workers, block_task, completed

CONNECT_S = 20.0


@contextmanager
def dask_workers(study: Study, address: str) -> Iterator[Workers]:
    """Join a scheduler until the block ends.

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
