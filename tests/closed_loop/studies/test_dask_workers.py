"""Studies on workers of dask.distributed: the same bytes."""

import os
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from unittest import mock

import pytest

from steer_by_wire.closed_loop.studies.run_study import run_missing
from steer_by_wire.closed_loop.studies.workers import dask_workers
from tests.support.runs.small_study import complete, make_scenarios, never, open_store
from tests.support.suite.combinations import sampled

pytestmark = pytest.mark.skipif(
    find_spec("distributed") is None, reason="dask.distributed is not installed (the extra studies)"
)


WORKER: dict[str, Any] = sampled({"processes": False, "protocol": "tcp://"}, {})
"""On a push the worker is a thread behind a socket; the weekly run starts a process."""


@pytest.mark.filterwarnings("default")  # what dask warns of is not ours
def test_a_worker_of_dask_gives_the_same_bytes(tmp_path: Path) -> None:
    distributed = import_module("distributed")
    expected = complete(tmp_path / "threads").results.read_bytes()
    scenarios = make_scenarios(tmp_path / "dask")
    store = open_store(tmp_path / "dask", scenarios)
    # dask leaves what its workers need in this process's environment, which others inherit.
    with (
        mock.patch.dict(os.environ),
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, dashboard_address=None, **WORKER
        ) as cluster,
        dask_workers(scenarios.study, cluster.scheduler_address) as workers,
    ):
        assert run_missing(store, workers, lambda _: None, never)
    assert store.results.read_bytes() == expected
