"""Many machines, through dask.distributed: the same blocks, the same results.

Every worker makes the study from its settings by itself and keeps what runs share, as a thread
does. Workers need this package in the same version, and waypoint and trace files of the same names.
"""

import importlib
import json
import signal
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import Any

from ...command_line import installation
from ...runtime.program import handled
from ...runtime.settings import SettingsError
from ...studies.compute import Computed, Computer
from ...studies.sampling import make_design
from ...studies.scenario import Scenarios
from ...studies.study import Study, study_factors
from ...studies.study_file import StudySettings
from .workers import NOTHING, PATIENCE_S, WAITING_PER_WORKER, Block, ShouldStop

CONNECT_S = 20.0


class DaskWorkers:
    """Workers of a scheduler."""

    def __init__(self, client: Any, study: Study, description: str) -> None:
        self._client = client
        self._payload = _payload(study)
        self._wait = importlib.import_module("distributed").wait
        self.description = description

    @property
    def count(self) -> int:
        """How many compute at the same time."""
        return max(1, sum(int(threads) for threads in self._client.nthreads().values()))

    def compute(self, blocks: Iterable[Block], should_stop: ShouldStop) -> Iterator[Computed]:
        """Yield what is done."""
        source = iter(blocks)
        waiting: set[Any] = set()
        while True:
            free = self.count * WAITING_PER_WORKER - len(waiting)
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
            return Computed(*future.result())
        error = future.exception() if future.status == "error" else None
        if isinstance(error, SettingsError):
            raise error
        reason = ": ".join([*getattr(error, "__notes__", ()), str(error or future.status)])
        raise OSError(f"{self.description} have failed: {reason}")


@contextmanager
def dask_workers(study: Study, address: str | None, workers: int | None) -> Iterator[DaskWorkers]:
    """Join a scheduler, or start ``workers`` processes on this machine, until the block ends.

    Raises SettingsError where distributed is missing or no scheduler answers.
    """
    try:
        distributed = importlib.import_module("distributed")
    except ImportError as error:
        raise SettingsError(
            "--scheduler and --workers need dask.distributed:"
            f" {installation('pyarrow', 'distributed')}"
        ) from error
    with ExitStack() as stack:
        if address is None:
            # They ignore Ctrl-C, which a terminal sends to all: they finish their current block,
            # and the study ends them.
            with handled(signal.SIGINT, signal.SIG_IGN):
                cluster = distributed.LocalCluster(
                    n_workers=workers, threads_per_worker=1, dashboard_address=None
                )
            stack.enter_context(cluster)
            client = stack.enter_context(distributed.Client(cluster))
            description = f"{workers} processes through dask"
        else:
            try:
                client = stack.enter_context(distributed.Client(address, timeout=CONNECT_S))
            except (OSError, ValueError) as error:
                raise SettingsError(f"--scheduler {address}: nobody answers there") from error
            description = f"the workers of {address}"
        yield DaskWorkers(client, study, description)


def compute_block(payload: str, ids: Sequence[int]) -> tuple[Any, Any, Any]:
    """Compute runs on a worker; returns the fields of ``Computed``."""
    computed = _computer(payload).compute(list(ids), lambda: False)
    return computed.ids, computed.ends, computed.figures


@lru_cache(maxsize=2)
def _computer(payload: str) -> Computer:
    """Return the computer of a study's runs, from the output of ``_payload``."""
    study = json.loads(payload)
    settings = StudySettings.model_validate_json(json.dumps(study["settings"]))
    design = make_design(study_factors(settings, study["file"]), settings.sampling)
    tables = study["plant"], study["controllers"]
    made = Study(study["file"], settings, *tables, design, study["fastmath"], study["bus"])
    return Computer(Scenarios(made))


def _payload(study: Study) -> str:
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
