"""Runs of a study in which something gives way, and how one that cannot be computed is reported."""

from pathlib import Path

import numpy as np
import pytest

from steer_by_wire.closed_loop.compiled.engine import Outcome, run_compiled
from steer_by_wire.closed_loop.pair.virtual_pair import make_virtual_pair, run_virtual_nodes
from steer_by_wire.closed_loop.studies import compiled_runs, scenario
from steer_by_wire.closed_loop.studies.compiled_figures import COLUMNS
from steer_by_wire.closed_loop.studies.compiled_runs import Computer
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.plant_emulator.evaluation.run_verdict import RANGE_M
from steer_by_wire.plant_emulator.settings import plant_preset
from steer_by_wire.runtime.settings import SettingsError
from tests.support.runs.compiled_runs import assert_same_as_nodes
from tests.support.runs.small_study import make_scenarios, never

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


@pytest.mark.parametrize(("text", "run"), [(LOST, 3), (UNCLEAR, 0)])
def test_a_run_in_which_the_wheel_or_the_count_is_lost_equals_the_nodes(
    text: str, run: int, tmp_path: Path
) -> None:
    pair = make_scenarios(tmp_path, text).pair(run)
    assert_same_as_nodes(pair.plant, pair.controller)


def test_latency_is_that_of_the_commands_followed_whatever_was_computed_before(
    tmp_path: Path,
) -> None:
    """A steering that has gone to its safe state follows none, on the network that others share."""
    line = 'latency.downlink = { model = "gamma", mean_s = 0.1, spread_s = 0.04 }'
    scenarios = make_scenarios(tmp_path, LOST.replace("[[factors]]", f"{line}\n[[factors]]"))
    together = Computer(scenarios).compute(range(4), never).figures
    alone = [Computer(scenarios).compute([run], never).figures[0] for run in range(4)]
    np.testing.assert_array_equal(together, alone)
    latency = COLUMNS.index("latency_mean_s")
    assert together[2, latency] != together[0, latency]


def test_a_run_that_leaves_the_sensors_range_is_that_of_the_nodes_up_to_there() -> None:
    plant = plant_preset(
        "paper_nominal",
        [
            "duration_s=30",
            "vehicle.speed_m_s=27.77777777777778",
            "sensor_noise.lateral_error_m=0.02",
        ],
    )
    controller = controller_preset("practical_predictor", ["limits.steer_rad_max=0.001"])
    run = run_compiled(plant, controller)
    assert run.outcome is Outcome.LEFT_RANGE
    assert abs(run.lateral_error_m[-2]) < RANGE_M < abs(run.lateral_error_m[-1])
    nodes = make_virtual_pair(plant, controller, controller_samples_max=10_000)
    run_virtual_nodes(nodes.plant, nodes.controller, None, None, never)
    samples, ticks = nodes.plant.samples, nodes.controller.samples
    error_m = [sample.lateral_error_m for sample in samples[: len(run.time_s)]]
    np.testing.assert_array_equal(run.lateral_error_m, error_m)
    sent_rad = [tick.sent_steer_rad for tick in ticks[: len(run.sent_rad)]]
    np.testing.assert_array_equal(run.sent_rad, sent_rad)
    assert len(run.time_s) < len(samples)
    assert nodes.plant.report()["not_available"] > 0


def test_an_error_names_its_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    computer = Computer(make_scenarios(tmp_path, LOST))

    def refuse(*_: object, **__: object) -> None:
        raise SettingsError("nothing doing")

    monkeypatch.setattr(compiled_runs, "run_compiled", refuse)
    with pytest.raises(SettingsError, match="run 2: nothing doing"):
        computer.compute([2], never)

    def fail(*_: object, **__: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr(compiled_runs, "run_compiled", fail)
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
