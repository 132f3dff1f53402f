"""The smoothed states of a recording against the truth, and their deviations against the errors."""

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from steer_by_wire.closed_loop.compiled.engine import CompiledRun, run_compiled
from steer_by_wire.controller.filters.settings import VehicleModelSettings
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.plant_emulator.network.latency_distributions import Distribution
from steer_by_wire.plant_emulator.network.settings import BothLatencySettings, LatencySettings
from steer_by_wire.plant_emulator.path.settings import DoubleLaneChangeSettings
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.plant_emulator.steering.settings import UNGUARDED
from steer_by_wire.plant_emulator.vehicle.settings import ActuatorSettings, VehicleSettings
from steer_by_wire.tools.analyze.__main__ import main as analyze
from steer_by_wire.tools.analyze.pictures import draw_smoothed
from steer_by_wire.tools.analyze.smoothing import (
    COLUMNS,
    VEHICLE_STATES,
    SmoothedTable,
    smooth_delay,
    smooth_lag,
    smooth_vehicle,
)
from steer_by_wire.tools.analyze.vehicle_fit import UNKNOWN, yaw_rate_fit
from steer_by_wire.tools.run.__main__ import main as run_loop
from tests.support.suite.unrendered import unrendered as unrendered

VEHICLE_FILE = Path(__file__).parents[3] / "tools" / "design" / "highway_vehicle.toml"
CONTROLLER = controller_preset("highway_predictor")
SPEED_M_S = 12.5
PERIOD_S = 0.01


def vehicle() -> VehicleModelSettings:
    assert isinstance(CONTROLLER.nominal_model, VehicleModelSettings)
    return CONTROLLER.nominal_model


def driven(lag_s: float = 0.0, spread_s: float = 0.0, **changes: float) -> CompiledRun:
    network = LatencySettings(
        model=Distribution.GAMMA if spread_s else Distribution.CONSTANT,
        mean_s=0.1,
        spread_s=spread_s,
    )
    plant = PlantSettings(
        duration_s=20.0,
        vehicle=VehicleSettings(speed_m_s=SPEED_M_S, **changes),
        path=DoubleLaneChangeSettings(kind="double_lane_change"),
        actuator=ActuatorSettings(lag_s=lag_s),
        latency=BothLatencySettings(downlink=network),
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


@pytest.mark.parametrize("lag_s", [0.02, 0.05, 0.1, 0.27])
@pytest.mark.parametrize("spread_s", [0.0, 0.03])
def test_a_lag_is_found_within_three_of_its_deviations(lag_s: float, spread_s: float) -> None:
    run = driven(lag_s, spread_s)
    lag = smooth_lag(PERIOD_S, run.wheel_angle_rad, run.command_rad)
    assert abs(lag.values - lag_s).max() < max(3.0 * lag.deviations.max(), 0.05 * lag_s)
    assert lag.deviations.mean() < 0.1 * lag_s


def test_a_steering_without_lag_shows_none_and_one_that_never_moves_nothing() -> None:
    run = driven()
    assert smooth_lag(PERIOD_S, run.wheel_angle_rad, run.command_rad).values.max() < 0.002
    still = np.zeros(200)
    assert np.isinf(smooth_lag(PERIOD_S, still, still).deviations).all()


def test_a_delay_that_walks_is_followed_with_errors_as_large_as_stated() -> None:
    random = np.random.default_rng(3)
    time_s = np.arange(3000, dtype=np.float64) * PERIOD_S
    truth_s = 0.15 + np.cumsum(random.standard_normal(3000)) * 0.02 * np.sqrt(PERIOD_S)
    smoothed = smooth_delay(time_s, truth_s + 0.03 * random.standard_normal(3000))
    normalised = (smoothed.values - truth_s) / smoothed.deviations
    assert 0.7 < np.sqrt(np.mean(normalised**2)) < 1.3
    assert smoothed.deviations.mean() < 0.2 * 0.03


@pytest.mark.parametrize(
    ("changes", "times_gradient"),
    [
        ({}, 1.0),
        ({"virtual_mass_kg": 1280.0}, 0.64),
        ({"virtual_mass_kg": 6000.0}, 3.0),
        (
            {"front_cornering_stiffness_n_rad": 57e3, "rear_cornering_stiffness_n_rad": 150e3},
            10 / 3,
        ),
    ],
)
@pytest.mark.parametrize("offset_rad", [0.0, 0.01])
def test_the_yaw_rate_shows_that_the_car_is_another(
    changes: dict[str, float], times_gradient: float, offset_rad: float
) -> None:
    run = driven(**changes)
    random = np.random.default_rng(5)
    yaw_rate_rad_s = run.yaw_rate_rad_s + 0.002 * random.standard_normal(len(run.time_s))
    wheel_rad = run.wheel_angle_rad - offset_rad
    fit = yaw_rate_fit(vehicle(), [SPEED_M_S], PERIOD_S, wheel_rad, yaw_rate_rad_s)
    # V δ/(L + K V²) of a held wheel, by hand: L 2.846 m, K 3.887e-3 s²/m of the nominal vehicle.
    least_m, gradient_m = 1.3008 + 1.5453, 3.887e-3 * SPEED_M_S**2
    ratio = (least_m + gradient_m) / (least_m + times_gradient * gradient_m)
    assert fit.yaw_rate_ratio == pytest.approx(ratio, abs=0.02)
    word = "fits" if not changes else "DOES NOT FIT"
    assert word in fit.in_words()


def test_a_wheel_that_rests_or_a_speed_that_changes_shows_no_fit() -> None:
    still, moves = np.zeros(200), np.sin(0.01 * np.arange(200.0))
    for speeds_m_s, wheel_rad in (([10.0], still), ([10.0, 12.0], moves)):
        fit = yaw_rate_fit(vehicle(), speeds_m_s, PERIOD_S, wheel_rad, wheel_rad)
        assert fit.in_words() == "vehicle: the log does not show whether the model fits"


@pytest.mark.usefixtures("unrendered")
@pytest.mark.parametrize("law", ["predictor", "packet"])
def test_analyze_smooths_a_recording_and_says_the_lag(
    law: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    settings = ("actuator.lag_s=0.05", "latency.downlink.mean_s=0.08", "duration_s=8")
    sets = [word for setting in settings for word in ("--set", f"plant.{setting}")]
    presets = ["--preset", "highway_nominal", "--preset", f"highway_{law}"]
    assert run_loop([*presets, *sets, "--out", str(tmp_path / "run")]) == 0
    log = tmp_path / "run" / "candump.log"
    out = tmp_path / "logs"
    assert analyze([str(log), "--out", str(out), "--smooth", str(VEHICLE_FILE)]) == 0
    figures = json.loads((out / "candump" / "figures.json").read_text())["smoothed"]
    lag_s = figures["steering_lag_s"]["mean"]
    assert lag_s == pytest.approx(0.05, abs=0.002)
    printed = capsys.readouterr().out
    assert f"smoothed steering lag: {1e3 * lag_s:.2f} ± " in printed
    assert "vehicle: the model fits, yaw rate 1.0" in printed
    assert "Smoothed: estimate" in (out / "candump" / "report.html").read_text(encoding="utf-8")
    assert 0.08 < figures["delay_s"]["mean"] < 0.092  # to the sample after it acts
    assert abs(figures["steering_offset_rad"]["mean"]) < 0.001
    assert figures["vehicle"]["yaw_rate_ratio"] == pytest.approx(1.0, abs=0.02)
    table = np.genfromtxt(out / "candump" / "smoothed.csv", delimiter=",", names=True)
    assert len(table) > 780
    assert np.diff(table["time_s"]) == pytest.approx(PERIOD_S, rel=1e-2)


def test_what_nothing_shows_is_drawn_as_nothing(tmp_path: Path) -> None:
    table = SmoothedTable(tmp_path / "smoothed.csv", vehicle())
    table.time_s, table.values = np.arange(3.0), np.full((3, len(COLUMNS)), np.nan)
    table.deviations = np.full_like(table.values, np.inf)
    table.figures["vehicle"] = {"in_words": UNKNOWN.in_words()}
    assert draw_smoothed(table).png.startswith(b"\x89PNG")


def test_a_log_without_enough_is_skipped_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "short.log"
    log.write_text("(0.0) vcan0 123#00\n")
    arguments = [str(log), "--out", str(tmp_path / "logs"), "--smooth", str(VEHICLE_FILE)]
    assert analyze(arguments) == 2
    assert "--smooth needs a log with times" in capsys.readouterr().err
