"""The standard tests: scores whose values are known by other means, and what a user reads."""

import math
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from steer_by_wire.closed_loop.studies.vehicle_tests.scores import (
    DWELL_ENDS_S,
    DWELL_FACTORS,
    Drive,
    drive,
    dwell_score,
    held,
    ramp,
    scores_of,
    sine_with_dwell,
    steady_score,
    step_score,
)
from steer_by_wire.closed_loop.studies.vehicle_tests.settings import VehicleTestSettings
from steer_by_wire.plant_emulator.settings import plant_preset
from steer_by_wire.plant_emulator.vehicle.car.steady_state import steady_turn
from steer_by_wire.tools.study.__main__ import main

SPEED_M_S = 100.0 / 3.6
NEARLY_LINEAR = [
    "car={friction=3, front_relaxation_m=0.01, rear_relaxation_m=0.01, cg_height_m=0}",
    "actuator={lag_s=0.05}",
]


def test_the_step_is_that_of_the_linear_vehicle_where_the_tyres_are_nearly_so() -> None:
    """The response of the textbook's single track, by scipy; the lag is before the wheels."""
    plant = plant_preset("large_sedan", NEARLY_LINEAR)
    v = plant.vehicle
    m, j, a, b = (
        v.virtual_mass_kg,
        v.yaw_inertia_kg_m2,
        *(v.front_axle_distance_m, v.rear_axle_distance_m),
    )
    f, r, u = v.front_cornering_stiffness_n_rad, v.rear_cornering_stiffness_n_rad, SPEED_M_S
    matrix = [
        [-(f + r) / (m * u), -1.0 + (r * b - f * a) / (m * u * u), f / (m * u)],
        [(r * b - f * a) / j, -(f * a * a + r * b * b) / (j * u), f * a / j],
        [0.0, 0.0, -1.0 / 0.05],
    ]
    lagged = signal.StateSpace(matrix, [[0.0], [0.0], [1.0 / 0.05]], np.eye(3), np.zeros((3, 1)))
    time_s, states = signal.step(lagged, T=np.arange(0.0, 4.0, 1e-4))
    yaw, wheel = states[:, 1], states[:, 2]
    half_s, response_s = (time_s[np.argmax(x / x[-1] >= q)] for x, q in ((wheel, 0.5), (yaw, 0.9)))
    scored = step_score(drive(plant, u, held(2e-3), 4.0))
    assert scored.yaw_response_s == pytest.approx(response_s - half_s, abs=2.5e-3)
    assert scored.yaw_peak_s == pytest.approx(time_s[np.argmax(yaw)] - half_s, abs=5e-3)
    assert scored.yaw_overshoot == pytest.approx(np.max(yaw) / yaw[-1] - 1.0, abs=5e-3)


def test_the_gradient_is_that_of_steady_turns_by_algebra() -> None:
    plant = plant_preset("large_sedan")
    assert plant.car is not None
    low_rad, high_rad = (
        steady_turn(plant.vehicle, plant.car, SPEED_M_S, lateral / SPEED_M_S**2).steer_rad
        - (1.45 + 1.491) * lateral / SPEED_M_S**2
        for lateral in (0.5, 2.0)
    )
    turning = drive(plant, SPEED_M_S, ramp(2e-3), 12.0)
    gradient = steady_score(plant, turning).understeer_rad_s2_m
    assert gradient == pytest.approx((high_rad - low_rad) / 1.5, rel=0.01)


def test_a_sine_with_dwell_rests_half_a_second_at_its_second_peak() -> None:
    program = sine_with_dwell(0.1)
    at_s = np.arange(0.0, 3.0, 1e-4)
    steer = np.array([program(time_s) for time_s in at_s])
    assert (np.max(steer), np.min(steer)) == pytest.approx((0.1, -0.1))
    resting = at_s[steer < -0.1 + 1e-9]
    assert resting[[0, -1]] == pytest.approx([0.75 / 0.7, 0.75 / 0.7 + 0.5], abs=2e-4)
    assert at_s[np.nonzero(steer)[0][-1]] == pytest.approx(1 / 0.7 + 0.5, abs=2e-4)


def drive_of(share: float, moved_m: float) -> Drive:
    """Return a drive whose yaw rate rests at a share of its second peak."""
    time_s = np.arange(0.0, DWELL_ENDS_S + 2.0, 1e-3)
    yaw = np.where(time_s < DWELL_ENDS_S, -1.0, -share)
    moved = np.full_like(time_s, moved_m)
    return Drive(time_s, yaw, yaw, yaw, yaw, yaw_rate_rad_s=yaw, lateral_m_s2=yaw, aside_m=moved)


@pytest.mark.parametrize(
    ("share", "moved_m", "fails_from"),
    [(0.19, 1.9, None), (0.21, 1.9, 1.5), (0.19, 1.8, 5.0), (-0.5, 1.9, None)],
)
def test_a_car_fails_by_what_is_left_of_its_yaw_rate_or_by_its_displacement(
    share: float, moved_m: float, fails_from: float | None
) -> None:
    """The displacement counts from five times the steer of 0.3 g on."""
    runs = [drive_of(share, moved_m) for _ in DWELL_FACTORS]
    assert dwell_score(runs).fails_from == fails_from


def test_a_car_that_slides_at_the_rear_is_called_so_and_fails() -> None:
    plant = plant_preset(
        "bmw_320i", ["car.friction=0.6", "vehicle.rear_cornering_stiffness_n_rad=90000"]
    )
    scores = scores_of(plant, VehicleTestSettings(plants=("",), speed_km_h=60, lateral_m_s2=2))
    assert scores.steady.slides_first == "rear"
    assert scores.dwell.fails_from is not None
    assert scores.steady.understeer_rad_s2_m < 0.0
    assert scores.steady.lateral_m_s2_max <= 0.6 * 9.81


def test_a_user_reads_the_scores_and_what_is_wrong(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study, out = tmp_path / "own.toml", tmp_path / "out"
    study.write_text("[vehicle_tests]\nplants = ['large_sedan']\n", encoding="utf-8")
    assert main([str(study), "--out", str(out)]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "largest lateral acceleration [m/s²] 11.0" in printed
    assert "sine with dwell at 80 km/h (FMVSS 126) fails at 6.5 A" in printed
    rows = (out / "vehicle_tests.csv").read_text(encoding="utf-8").splitlines()
    assert math.isclose(float(rows[2].rsplit(",", 1)[1]), 11.0, abs_tol=0.01)
    assert (out / "vehicle_tests.png").stat().st_size > 1000
    for text, what in (
        ("plants = ['paper_nominal']", "a linear vehicle; it has to be a car"),
        ("plants = ['truck']\nlateral_m_s2 = 9", "drive more slowly"),
    ):
        study.write_text(f"[vehicle_tests]\n{text}\n", encoding="utf-8")
        assert main([str(study), "--out", str(out)]) == 2
        error = capsys.readouterr().err
        assert what in error
        assert "Traceback" not in error
