"""A law that reads samples takes its plant's sensor period, and every program says so."""

from pathlib import Path

import pytest

from steer_by_wire import simulate
from steer_by_wire.closed_loop.pair.agreed_period import pair_warnings, with_period_of
from steer_by_wire.closed_loop.studies.scenario import Scenarios
from steer_by_wire.closed_loop.studies.study import load_study
from steer_by_wire.controller.settings import PRESETS, controller_preset
from steer_by_wire.plant_emulator.settings import plant_preset
from steer_by_wire.runtime.settings import preset_names
from steer_by_wire.tools.run import __main__ as run

SAID = "link.sensor_period_ms = 50, as the plant has it, and not 10: law predictor reads"
STUDY = """
name = "slow_sensors"
[base]
plant_preset = "paper_nominal"
controllers = ["practical_pd", "practical_predictor"]
[base.plant]
duration_s = 2.0
sensor_period_ms = 50.0
"""


@pytest.mark.parametrize("name", preset_names(PRESETS))
def test_only_a_law_that_reads_samples_takes_its_plants_period(name: str) -> None:
    controller = controller_preset(name)
    reads = bool(controller.law_that_reads_the_vehicle)
    for period_ms in (controller.link.sensor_period_ms, 50.0):
        plant = plant_preset("paper_nominal", [f"sensor_period_ms={period_ms}"])
        agreed = with_period_of(plant, controller)
        differs = reads and period_ms == 50.0
        assert (agreed != controller) == differs
        assert not differs or agreed.link.sensor_period_ms == 50.0
        said = [line for line in pair_warnings(plant, controller) if "link.sensor" in line]
        assert bool(said) == differs
    rare = plant_preset("paper_nominal", ["sensor_period_ms=500"])
    assert "steers by no measurement older than" in "".join(pair_warnings(rare, controller))


def test_a_predictor_with_slow_sensors_predicts(capsys: pytest.CaptureFixture[str]) -> None:
    slow = {"plant.sensor_period_ms": 50.0, "plant.latency.downlink.mean_s": 0.08}
    done = simulate(controller="practical_predictor", duration_s=20.0, overrides=slow)
    assert done.rms_m < 0.012
    assert done.warnings[0].startswith(SAID)
    words = [word for key, value in slow.items() for word in ("--set", f"{key}={value}")]
    run.main(["--preset", "practical_predictor", *words, "--duration", "1"])
    assert f"warning: {SAID}" in capsys.readouterr().err


def test_a_study_names_the_controllers_whose_period_it_took(tmp_path: Path) -> None:
    file = tmp_path / "study.toml"
    file.write_text(STUDY, encoding="utf-8")
    scenarios = Scenarios(load_study(file))
    scenarios.check()
    (line,) = scenarios.warnings
    assert line.startswith(f"practical_predictor: {SAID}")
    assert scenarios.pair(1).controller.link.sensor_period_ms == 50.0
