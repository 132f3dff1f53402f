"""A study small enough to be run to its end in a test, and its store."""

from importlib import resources
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

from steer_by_wire.closed_loop.studies.result_files import Store
from steer_by_wire.closed_loop.studies.run_study import run_missing
from steer_by_wire.closed_loop.studies.scenario import Scenarios
from steer_by_wire.closed_loop.studies.study import load_study
from steer_by_wire.closed_loop.studies.workers import thread_workers

STUDY = """
name = "small"
[base]
plant_preset = "paper_corner_d"
controllers = ["practical_pd", "practical_pd_ddob"]
[base.plant]
duration_s = 5.0
[base.plant.latency.downlink]
model = "gamma"
loss = 0.05
[base.plant.latency.uplink]
loss = 0.02
[[factors]]
key = "plant.latency.downlink.mean_s"
values = [0.0, 0.08, 0.2]
[[factors]]
name = "jitter"
key = "plant.latency.downlink.spread_fraction"
values = [0.0, 0.4]
[[factors]]
name = "road"
key = "plant.path"
values = ["practical_ellipse", "straight"]
[sampling]
replicates = 2
seed = 11
"""
CHUNK_RUNS = 20


def never() -> bool:
    return False


def make_scenarios(folder: Path, text: str = STUDY) -> Scenarios:
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / "study.toml"
    file.write_text(text, encoding="utf-8")
    return Scenarios(load_study(file))


def open_store(folder: Path, scenarios: Scenarios, text: str = STUDY) -> Store:
    store = Store(folder / "out", scenarios, CHUNK_RUNS)
    store.open(text)
    return store


def complete(folder: Path, threads: int = 1, text: str = STUDY) -> Store:
    """Return the store of a study that has been run to its end."""
    scenarios = make_scenarios(folder, text)
    store = open_store(folder, scenarios, text)
    assert run_missing(store, thread_workers(scenarios, threads), lambda _: None, never)
    return store


def stored_row(store: Store, run: int) -> dict[str, Any] | None:
    """Return one row by its id; None if it is not stored."""
    chunks = sorted((store.folder / "chunks").glob("*.parquet"))
    for file in [store.results] if store.is_complete else chunks:
        for row in pq.read_table(file, filters=[("id", "=", run)]).to_pylist():
            return dict(row)
    return None


_SHIPPED = resources.files("steer_by_wire.closed_loop.studies") / "latency_jitter.toml"
_AFTER = _SHIPPED.read_text(encoding="utf-8").partition('name = "corner"')[2]
CORNERS = '[[factors]]\nname = "corner"' + _AFTER.partition("[sampling]")[0]
"""The factor of the corners of the paper's box."""
