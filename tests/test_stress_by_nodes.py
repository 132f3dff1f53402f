"""Runs that the compiled loop has no answer to: the nodes compute them, exactly."""

import math
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from controller.settings import ControllerSettings
from plant_emulator.settings import PlantSettings
from runtime.settings import SettingsError, load_settings, read_preset
from tests.small_study import make_scenarios, never
from tools.batch.engine import Outcome, run_batch
from tools.batch.plan import plan_run
from tools.batch.wire_plan import LostWheelError, UnclearSampleError
from tools.stress import compute, exact_run, scenario
from tools.stress.compute import Computer
from tools.stress.exact_run import NodeRun, StoppedError, run_exactly, run_nodes
from tools.stress.figures import COLUMNS
from tools.stress.replay import replay
from tools.stress.runner import run_study
from tools.stress.store import Store
from tools.stress.workers import Threads
from tools.stress_report import break_points as break_points_module
from tools.stress_report.axes import study_axes
from tools.stress_report.break_point_picture import draw_break_points
from tools.stress_report.page import page
from tools.stress_report.results import read_rows, read_study
from tools.stress_report.sections import break_point_section
from tools.stress_report.settings_section import study_section
from tools.stress_report.worst_runs import worst_runs
from tools.virtual_pair import make_virtual_pair

LOST = """
[base]
plant_preset = "paper_nominal"
controllers = ["practical_pd", "practical_predictor"]
[base.plant]
duration_s = 3.0
path = "practical_ellipse"
safety = { follow_tolerance_rad = 0.05, follow_time_ms = 50.0 }
disturbance = { steps = [{ at_s = 0.5, steering_offset_rad = 0.2 }] }
[[factors]]
key = "plant.actuator.dead_band_rad"
values = [0.0, 0.08]
"""
UNCLEAR = """
[base]
plant_preset = "paper_nominal"
controllers = ["practical_predictor"]
[base.plant]
duration_s = 1.0
sensor_period_ms = 1.0
latency.uplink = { model = "lognormal", mean_s = 0.1, spread_s = 0.05, order = "newest_wins" }
[base.controller]
link.sensor_period_ms = 1.0
"""


def settings(
    preset: str, plant: list[str], law: list[str]
) -> tuple[PlantSettings, ControllerSettings]:
    return (
        load_settings(
            PlantSettings, read_preset("plant_emulator.presets", "paper_nominal"), None, plant
        ),
        load_settings(ControllerSettings, read_preset("controller.presets", preset), None, law),
    )


@pytest.mark.parametrize(
    ("text", "run", "error"), [(LOST, 3, LostWheelError), (UNCLEAR, 0, UnclearSampleError)]
)
def test_a_run_that_is_not_compiled_is_that_of_the_nodes(
    text: str, run: int, error: type[Exception], tmp_path: Path
) -> None:
    scenarios = make_scenarios(tmp_path, text)
    pair = scenarios.pair(run)
    with pytest.raises(error):
        run_batch(pair.plant, pair.controller)
    computed = Computer(scenarios).compute([run], never)
    found = dict(zip(COLUMNS, computed.figures[0].tolist(), strict=True))
    assert found["by_nodes"] == 1.0
    assert np.isfinite([found["rms_m"], found["steer_rms_rad"], found["latency_mean_s"]]).all()


def test_a_study_with_such_runs_is_whole_replays_and_is_reported(tmp_path: Path) -> None:
    scenarios = make_scenarios(tmp_path, LOST)
    stores = []
    for name, threads in (("one", 1), ("two", 2)):
        store = Store(tmp_path / name, scenarios)
        store.open(LOST)
        assert run_study(store, Threads(scenarios, threads), lambda _: None, never)
        stores.append(store)
    one, two = stores
    assert one.results.read_bytes() == two.results.read_bytes()
    table = pq.read_table(one.results)
    assert table["by_nodes"].to_pylist() == [0, 0, 0, 1]
    assert table["ended_by"].to_pylist() == ["complete"] * 4
    made = replay(one, Computer(scenarios), 3)
    assert made.stored is not None
    assert made.differences == []
    study = read_study(one.folder)
    rows = read_rows(study)
    text = page("lost", [study_section(study, rows)])
    assert "1: the compiled loop has no answer to these" in text
    (again,) = [worst for worst in worst_runs(study, rows) if worst.id == 3]
    assert again.again_rms_m == pytest.approx(rows.rms_m[3], rel=1e-12)


def test_a_search_for_a_break_point_ends_where_the_nodes_would_take_for_ever(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = LOST.replace("values = [0.0, 0.08]", "values = [0.08]")
    text += '[[factors]]\nkey = "plant.latency.downlink.mean_s"\nvalues = [0.0, 0.05]\n'
    scenarios = make_scenarios(tmp_path, text)
    store = Store(tmp_path / "out", scenarios)
    store.open(text)
    assert run_study(store, Threads(scenarios, 1), lambda _: None, never)
    study = read_study(store.folder)
    rows = read_rows(study)
    axes = study_axes(study, rows)
    monkeypatch.setattr(break_points_module, "NODE_RUNS_MAX", 0)
    pd, predictor = break_points_module.break_points(study, rows, axes, 2)
    assert len(pd.by_seed_s) == 2
    assert predictor.by_seed_s == ()
    section = break_point_section(study, axes, [pd, predictor], [])
    assert any("Not searched" in note and "practical_predictor" in note for note in section.notes)
    draw_break_points([pd, predictor], axes, study.names)


@pytest.mark.parametrize(
    ("plant", "law", "outcome"),
    [
        (["duration_s=2", "latency.uplink.loss=0.3", "seed=3"], [], Outcome.COMPLETE),
        (
            ["duration_s=30", "vehicle.speed_km_h=100", "sensor_noise.lateral_error_m=0.02"],
            ["limits.steer_rad_max=0.001"],
            Outcome.LEFT_RANGE,
        ),
    ],
)
def test_the_nodes_end_where_a_compiled_run_does(
    plant: list[str], law: list[str], outcome: Outcome
) -> None:
    pair = settings("practical_pd", plant, law)
    plan = plan_run(*pair)
    compiled, nodes = run_batch(*pair, plan), run_nodes(*pair, plan)
    assert compiled.outcome is nodes.outcome is outcome
    for name in NodeRun._fields[1:]:
        np.testing.assert_array_equal(getattr(compiled, name), getattr(nodes, name))


def test_a_law_that_fails_ends_the_run_of_the_nodes_at_that_tick(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pair = settings("practical_pd", ["duration_s=3"], [])
    plan = plan_run(*pair)

    def failing(*settings: Any, **more: Any) -> Any:
        made = make_virtual_pair(*settings, **more)
        design = made.controller._law.design
        calls = count()

        def step(params: Any, state: Any, seen: Any) -> Any:
            state, output = design.step(params, state, seen)
            bad = next(calls) == 150
            return state, output._replace(steer_rad=math.nan) if bad else output

        made.controller._law.design = design._replace(step=step)
        return made

    whole = run_nodes(*pair, plan)
    monkeypatch.setattr(exact_run, "make_virtual_pair", failing)
    nodes = run_nodes(*pair, plan)
    assert nodes.outcome is Outcome.LAW_FAILED
    np.testing.assert_array_equal(nodes.sent_rad, whole.sent_rad[:150])
    # The sample at the instant of the tick that failed was taken before it.
    samples = int(np.searchsorted(plan.sample_ns, plan.tick_ns[150], side="right")) - (
        len(plan.sample_ns) - len(plan.time_s)
    )
    np.testing.assert_array_equal(nodes.lateral_error_m, whole.lateral_error_m[:samples])


def test_a_run_of_the_nodes_can_be_stopped_and_is_not_stored(tmp_path: Path) -> None:
    scenarios = make_scenarios(tmp_path, UNCLEAR)
    looks = iter([False, True])
    assert len(Computer(scenarios).compute([0], lambda: next(looks)).ids) == 0
    pair = scenarios.pair(0)
    with pytest.raises(StoppedError):
        run_exactly(pair.plant, pair.controller, should_stop=lambda: True)


def test_an_error_names_its_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    computer = Computer(make_scenarios(tmp_path, LOST))

    def refuse(*_: object, **__: object) -> None:
        raise SettingsError("nothing doing")

    monkeypatch.setattr(compute, "run_exactly", refuse)
    with pytest.raises(SettingsError, match="run 2: nothing doing"):
        computer.compute([2], never)

    def fail(*_: object, **__: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(compute, "run_exactly", fail)
    with pytest.raises(ZeroDivisionError) as raised:
        computer.compute([2], never)
    assert raised.value.__notes__ == ["run 2 of the study"]


def test_a_law_without_gains_is_refused_before_the_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(_: object) -> None:
        raise SettingsError("[estimator] has no gains")

    monkeypatch.setattr(scenario, "design_law", refuse)
    with pytest.raises(SettingsError, match=r"controller practical_pd: \[estimator\] has no gains"):
        make_scenarios(tmp_path, LOST).check()
