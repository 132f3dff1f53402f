"""The smoothed states of a recording against the truth, and their deviations against the errors."""

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from steer_by_wire.closed_loop.compiled.engine import CompiledRun, run_compiled
from steer_by_wire.controller.filters.settings import VehicleModelSettings
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.plant_emulator.network.settings import BothLatencySettings, LatencySettings
from steer_by_wire.plant_emulator.path.settings import DoubleLaneChangeSettings
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.plant_emulator.vehicle.settings import VehicleSettings
from steer_by_wire.tools.analyze.__main__ import main as analyze
from steer_by_wire.tools.analyze.smoothing import VEHICLE_STATES, smooth_vehicle
from steer_by_wire.tools.run.__main__ import main as run_loop
from tests.support.runs.unguarded import UNGUARDED
from tests.support.suite.unrendered import unrendered as unrendered

VEHICLE_FILE = Path(__file__).parents[3] / "tools" / "design" / "highway_vehicle.toml"
CONTROLLER = controller_preset("highway_stiff_predictor")
SPEED_M_S = 12.5
PERIOD_S = 0.01


def vehicle() -> VehicleModelSettings:
    assert isinstance(CONTROLLER.nominal_model, VehicleModelSettings)
    return CONTROLLER.nominal_model


def driven() -> CompiledRun:
    plant = PlantSettings(
        duration_s=20.0,
        vehicle=VehicleSettings(speed_m_s=SPEED_M_S),
        path=DoubleLaneChangeSettings(kind="double_lane_change"),
        latency=BothLatencySettings(downlink=LatencySettings(mean_s=0.1)),
        safety=UNGUARDED,
    )
    return run_compiled(plant, CONTROLLER)


def measured(run: CompiledRun) -> NDArray[np.float64]:
    """Errors with the noise that the estimator assumes, a tenth of them lost."""
    random = np.random.default_rng(7)
    seen = np.column_stack((run.lateral_error_m, run.heading_error_rad))
    seen += 0.002 * random.standard_normal(seen.shape)
    seen[random.random(len(seen)) < 0.1] = np.nan
    return seen


@pytest.mark.parametrize("offset_rad", [0.0, 0.01])
def test_states_and_offset_are_found_with_errors_as_large_as_stated(offset_rad: float) -> None:
    run = driven()
    wheel_rad = run.wheel_angle_rad - offset_rad
    smoothed = smooth_vehicle(vehicle(), SPEED_M_S, PERIOD_S, measured(run), wheel_rad)
    truth = {
        "yaw_rate_rad_s": run.yaw_rate_rad_s,
        "heading_error_rad": run.heading_error_rad,
        "lateral_error_m": run.lateral_error_m,
        "curvature_1_m": run.curvature_1_m,
        "steering_offset_rad": np.full(len(run.time_s), offset_rad),
    }
    for name, values in truth.items():
        column = VEHICLE_STATES.index(name)
        error = (smoothed.values[:, column] - values)[100:-100]
        stated = smoothed.deviations[100:-100, column]
        assert 0.2 < np.sqrt(np.mean((error / stated) ** 2)) < 1.2, name
    errors = smoothed.values[:, VEHICLE_STATES.index("lateral_error_m")] - run.lateral_error_m
    assert np.std(errors) < 0.35 * 0.002  # of the noise of one measurement


@pytest.mark.usefixtures("unrendered")
@pytest.mark.parametrize("law", ["predictor", "packet"])
def test_analyze_smooths_a_recording_and_says_the_offset(
    law: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    settings = ("actuator.lag_s=0.05", "latency.downlink.mean_s=0.08", "duration_s=8")
    sets = [word for setting in settings for word in ("--set", f"plant.{setting}")]
    presets = ["--preset", "highway_nominal", "--preset", f"highway_{law}"]
    assert run_loop([*presets, *sets, "--out", str(tmp_path / "run")]) == 0
    log, out = tmp_path / "run" / "candump.log", tmp_path / "logs"
    assert analyze([str(log), "--out", str(out), "--smooth", str(VEHICLE_FILE)]) == 0
    figures = json.loads((out / "candump" / "figures.json").read_text())["smoothed"]
    offset_rad = figures["steering_offset_rad"]["mean"]
    lag_s, delay_s = (figures[name]["mean"] for name in ("steering_lag_s", "delay_s"))
    printed = capsys.readouterr().out
    assert f"smoothed steering offset: {1e3 * offset_rad:.2f} ± " in printed
    assert f"smoothed steering lag: {1e3 * lag_s:.2f} ± " in printed
    assert lag_s == pytest.approx(0.05, abs=0.002)
    assert 0.08 < delay_s < 0.092  # to the sample after it acts
    assert "Smoothed: estimate" in (out / "candump" / "report.html").read_text(encoding="utf-8")
    assert abs(offset_rad) < 0.001
    table = np.genfromtxt(out / "candump" / "smoothed.csv", delimiter=",", names=True)
    assert len(table) > 780
    assert np.diff(table["time_s"]) == pytest.approx(PERIOD_S, rel=1e-2)


@pytest.mark.usefixtures("unrendered")
def test_no_lag_is_said_that_the_log_does_not_know(tmp_path: Path) -> None:
    jitter = "plant.latency.downlink={model='gamma', mean_s=0.08, spread_s=0.02}"
    assert run_loop(["--set", jitter, "--duration", "8", "--out", str(tmp_path / "run")]) == 0
    log = tmp_path / "run" / "candump.log"
    vehicle = str(log.with_name("plant_emulator.toml"))
    assert analyze([str(log), "--out", str(tmp_path), "--smooth", vehicle]) == 0
    figures = json.loads((tmp_path / "candump" / "figures.json").read_text())["smoothed"]
    assert "steering_lag_s" not in figures


def test_a_log_without_enough_is_skipped_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "short.log"
    log.write_text("(0.0) vcan0 123#00\n")
    arguments = [str(log), "--out", str(tmp_path / "logs"), "--smooth", str(VEHICLE_FILE)]
    assert analyze(arguments) == 2
    assert "--smooth needs a log with times" in capsys.readouterr().err
