"""Studies give the same bytes whatever computes them and however often they are interrupted."""

import json
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from steer_by_wire import sweep
from steer_by_wire.closed_loop.compiled.engine import run_compiled
from steer_by_wire.closed_loop.compiled.schedule import schedule_run
from steer_by_wire.closed_loop.pair.virtual_pair import run_virtual_nodes
from steer_by_wire.closed_loop.studies.compiled_runs import Computed, Computer
from steer_by_wire.closed_loop.studies.result_files import Store
from steer_by_wire.closed_loop.studies.run_study import run_missing
from steer_by_wire.closed_loop.studies.scenario import Scenarios
from steer_by_wire.closed_loop.studies.study import load_study
from steer_by_wire.closed_loop.studies.workers import Block, ShouldStop, thread_workers
from steer_by_wire.controller.node.node import ControllerNode
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.plant_emulator.node.node import PlantNode
from steer_by_wire.plant_emulator.settings import PlantSettings, plant_preset
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.settings import SettingsError, load_settings
from steer_by_wire.tools.study import __main__ as study_program
from steer_by_wire.tools.study.program import write_settings
from tests.support.runs.run_of_nodes import assert_nodes_reproduce
from tests.support.runs.small_study import (
    CHUNK_RUNS,
    STUDY,
    complete,
    make_scenarios,
    never,
    open_store,
    stored_row,
)
from tests.support.runs.stored_pair import pair_of_row

RUNS = 3 * 2 * 2 * 2 * 2


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Store:
    """A study run at once, on one thread."""
    return complete(tmp_path_factory.mktemp("whole"))


class Interrupted:
    """Asks for the end after it has been looked at so often: before every run, and in between."""

    def __init__(self, looks: int) -> None:
        self._left = looks

    def __call__(self) -> bool:
        self._left -= 1
        return self._left <= 0


class Backwards:
    """Computes blocks in the wrong order, each run by itself."""

    description = "backwards"

    def __init__(self, scenarios: Scenarios) -> None:
        self._computer = Computer(scenarios)

    def compute(self, blocks: Iterable[Block], should_stop: ShouldStop) -> Iterator[Computed]:
        runs = [run for block in blocks for run in block]
        for run in reversed(runs):
            if should_stop():
                return
            yield self._computer.compute([run], never)


def test_rows_are_sorted_and_whole(whole: Store) -> None:
    table = pq.read_table(whole.results)
    assert table["id"].to_pylist() == list(range(RUNS))
    assert set(table["verdict"].to_pylist()) == {"holds"}
    assert table["mean_s"].type == "double"
    assert table["road"].type == "string"
    assert not (whole.folder / "chunks").exists()
    assert np.isfinite(table["rms_m"].to_numpy()).all()


def test_two_threads_give_the_same_bytes(whole: Store, tmp_path: Path) -> None:
    assert complete(tmp_path, threads=2).results.read_bytes() == whole.results.read_bytes()


@pytest.mark.parametrize("order", [lambda s: thread_workers(s, 1), Backwards])
def test_an_interrupted_study_goes_on_and_gives_the_same_bytes(
    whole: Store, tmp_path: Path, order: Callable[[Scenarios], Any]
) -> None:
    scenarios = make_scenarios(tmp_path)
    stored = []
    for looks in (8, 17, 8):
        store = open_store(tmp_path, scenarios)
        assert not run_missing(store, order(scenarios), lambda _: None, Interrupted(looks))
        assert not store.is_complete
        stored.append(store.stored())
        assert sorted(run for ids in store.missing() for run in ids) == [
            run for run in range(RUNS) if stored_row(store, run) is None
        ]
    assert 0 < stored[0] < stored[1] < stored[2] < RUNS
    computed: list[int] = []
    store = open_store(tmp_path, scenarios)
    assert run_missing(store, order(scenarios), computed.append, never)
    assert sum(computed) == RUNS - stored[-1]
    assert store.results.read_bytes() == whole.results.read_bytes()


def test_a_complete_study_computes_nothing(whole: Store) -> None:
    scenarios = Scenarios(load_study(whole.folder.parent / "study.toml"))
    store = Store(whole.folder, scenarios, CHUNK_RUNS)
    store.open(STUDY)
    computed: list[int] = []
    assert store.stored() == RUNS
    assert run_missing(store, thread_workers(scenarios, 1), computed.append, never)
    assert computed == []


def test_another_study_is_not_mixed_in(whole: Store, tmp_path: Path) -> None:
    other = make_scenarios(tmp_path, STUDY.replace("seed = 11", "seed = 12"))
    with pytest.raises(SettingsError, match="holds the results of another study: sampling differ"):
        Store(whole.folder, other).open(STUDY)


def test_a_row_holds_what_makes_the_run_again(whole: Store) -> None:
    record = json.loads((whole.folder / "study.json").read_text(encoding="utf-8"))
    scenarios = Scenarios(load_study(whole.folder.parent / "study.toml"))
    for run in (0, 13, RUNS - 1):
        row = stored_row(whole, run)
        assert row is not None
        assert pair_of_row(record, row) == scenarios.pair(run)
        assert_nodes_reproduce(scenarios, row)
        commands = write_settings(scenarios, run, whole.folder)
        file = whole.folder / "replay" / str(run) / "plant_emulator.toml"
        assert load_settings(PlantSettings, file=file) == scenarios.pair(run).plant
        assert commands[0].startswith(f"steer-by-wire run {file} ")


def test_results_do_not_go_on_with_other_recorded_latencies(tmp_path: Path) -> None:
    trace = tmp_path / "trace.csv"
    trace.write_text("latency_s\n0.01\n", encoding="utf-8")
    line = f'[base.plant.latency.uplink]\ntrace_file = "{trace.as_posix()}"\n'
    text = STUDY.replace("[base.plant.latency.uplink]\n", line)
    Store(tmp_path / "out", make_scenarios(tmp_path, text)).open(text)
    trace.write_text("latency_s\n0.02\n", encoding="utf-8")
    with pytest.raises(SettingsError, match="files differ"):
        Store(tmp_path / "out", make_scenarios(tmp_path, text)).open(text)


def test_results_do_not_go_on_with_another_version_of_an_own_law(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(tmp_path))
    module = tmp_path / "law_of_this_study.py"
    module.write_text("from steer_by_wire.controller.laws.pd import LAW\n", encoding="utf-8")
    text = STUDY.replace(
        "[base.plant", '[base.controller]\nlaw = "law_of_this_study:LAW"\n\n[base.plant', 1
    )
    Store(tmp_path / "out", make_scenarios(tmp_path, text)).open(text)
    Store(tmp_path / "out", make_scenarios(tmp_path, text)).open(text)
    module.write_text(module.read_text(encoding="utf-8") + "# other gains\n", encoding="utf-8")
    with pytest.raises(SettingsError, match="files differ"):
        Store(tmp_path / "out", make_scenarios(tmp_path, text)).open(text)


@pytest.mark.parametrize("wheel", [None, "still"])
@pytest.mark.parametrize("way", ["uplink", "downlink"])
@pytest.mark.parametrize("engine", ["virtual", "compiled"])
def test_a_network_that_lets_nothing_through_is_a_result_too(
    wheel: str | None, way: str, engine: Any
) -> None:
    lost = {f"plant.latency.{way}.loss": 1.0}
    found = sweep({}, overrides=lost, hand_wheel=wheel, engine=engine, duration_s=2.0)
    assert found["verdict"].tolist() == ["no start"]


def test_lost_frames_are_counted_as_the_plant_counts_them() -> None:
    plant = plant_preset(
        "paper_corner_a",
        [
            "duration_s=5",
            "latency.downlink.loss=0.2",
            "latency.downlink.burst_frames=5",
            "latency.downlink.model=gamma",
            "latency.downlink.mean_s=0.05",
            "latency.downlink.spread_s=0.03",
            "latency.uplink.schedule=[{time_s=0.0, mean_s=0.0},{time_s=2.0, mean_s=0.1, loss=0.3}]",
        ],
    )
    law = controller_preset("practical_pd")
    node = PlantNode(plant, 0)
    run_virtual_nodes(node, ControllerNode(law, 0), None, None, never)
    plan = schedule_run(plant, law)
    report = node.report()
    ticks = len(run_compiled(plant, law, plan).tick_s)
    assert plan.commands_lost[ticks] == report["downlink"]["lost"] > 0
    assert plan.measurements_lost[-1] == report["uplink"]["lost"] > 0


def test_the_program_says_sizes_runs_and_replays(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    make_scenarios(tmp_path)
    assert study_program.main(["study.toml", "--dry-run"]) == ExitStatus.OK
    printed = capsys.readouterr().out
    assert f"runs: {RUNS} = 12 points (grid) x 2 replicates x 2 controllers" in printed
    assert not (tmp_path / "out").exists()
    assert study_program.main(["study.toml", "--workers", "2", "--no-report"]) == ExitStatus.OK
    assert "results: out/study/small/results.parquet" in capsys.readouterr().out
    assert study_program.main(["study.toml", "--replay", "17"]) == ExitStatus.OK
    printed = capsys.readouterr().out
    assert "steer-by-wire run out/study/small/replay/17/plant_emulator.toml" in printed
    assert study_program.main(["study.toml", "--replay", "4800"]) == ExitStatus.SETTINGS
    assert "the study has runs 0 to 47" in capsys.readouterr().err
