"""Cars that nobody here tuned for, designed and then held in a simulator written apart.

The simulator shares no line with the project: SAE 2018-01-1086 (1) over a tick, in which the wheel
rests, by scipy's matrix exponential, and the PD as one line of arithmetic.
"""

from collections import deque
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.runtime.settings import load_settings
from steer_by_wire.tools.design import __main__ as design_gains
from tests.support.suite.combinations import sampled
from tests.support.suite.same_process import same_process as same_process

Array = NDArray[np.float64]
BUS = {
    "vehicle": "m = 12000 J = 110e3 cf = 450e3 cr = 700e3 lf = 3.3 lr = 2.4 ls = 4.0 V = 11.1",
    "speed_m_s": (30.0 / 3.6, 50.0 / 3.6),
    "virtual_mass_kg": (10000.0, 16000.0),
}
CITY_CAR = {
    "vehicle": "m = 950 J = 1150 cf = 85e3 cr = 105e3 lf = 0.95 lr = 1.25 ls = 2.0 V = 2.8",
    "speed_m_s": (2.0, 3.6),
    "virtual_mass_kg": (850.0, 1500.0),
}
SEDAN = {
    "vehicle": "m = 1600 J = 2700 cf = 120e3 cr = 150e3 lf = 1.25 lr = 1.5 ls = 2.0 V = 5.6",
    "speed_m_s": (4.2, 7.0),
    "virtual_mass_kg": (1400.0, 2600.0),
}
CARS = [
    pytest.param(BUS, 150.0, id="a bus of 12 t at 30 to 50 km/h"),
    pytest.param(CITY_CAR, 15.0, id="a small city car"),
    pytest.param(SEDAN, 30.0, id="a sedan"),
]
KEYS = {
    "m": "virtual_mass_kg",
    "J": "yaw_inertia_kg_m2",
    "cf": "front_cornering_stiffness_n_rad",
    "cr": "rear_cornering_stiffness_n_rad",
    "lf": "front_axle_distance_m",
    "lr": "rear_axle_distance_m",
    "ls": "preview_distance_m",
    "V": "speed_m_s",
}
SPEC = """
name = "car"
laws = ["pd"]
peak_sensitivity_max = 3
noise_gain_rad_m_max = 3
delay = {{ ms_max = 100, step_ms = 50, margin_ms = 50 }}
d_stability = {{ settling_1_s = 0.3, bandwidth_rad_s = 15, cone_angle_deg = 120 }}
search = {{ starts = 1, generations = 12 }}
[course]
duration_s = 20
friction_share_max = 0.3
paths = [{{ kind = "circle", radius_m = {radius_m} }}]
"""
RATE_HZ, DURATION_S = 100, 20
DELAY_TICKS = (0, 10)


def numbers(car: dict[str, Any]) -> dict[str, float]:
    words = car["vehicle"].replace(" = ", "=").split()
    return {key: float(value) for key, value in (word.split("=") for word in words)}


def written(car: dict[str, Any], radius_m: float, folder: Path) -> list[str]:
    """Write vehicle and specification; returns the words of the command."""
    lines = ["[vehicle]", *(f"{KEYS[key]} = {value}" for key, value in numbers(car).items())]
    ranges = [f"{key} = {list(car[key])}" for key in ("speed_m_s", "virtual_mass_kg")]
    (folder / "car.toml").write_text("\n".join([*lines, "[uncertainty]", *ranges]))
    (folder / "spec.toml").write_text(SPEC.format(radius_m=radius_m))
    return [str(folder / "car.toml"), "--spec", str(folder / "spec.toml"), "--out", str(folder)]


def simulated_m(car: dict[str, Any], radius_m: float, gains: tuple[float, ...]) -> Array:
    """Return the lateral error at the ticks, shape (ticks, corners * delays)."""
    corners = [(v, m) for v in car["speed_m_s"] for m in car["virtual_mass_kg"]]
    v, m, late = np.array([(*one, ticks) for one in corners for ticks in DELAY_TICKS]).T
    c = numbers(car)
    turning = c["lr"] * c["cr"] - c["lf"] * c["cf"]
    damping = c["lf"] ** 2 * c["cf"] + c["lr"] ** 2 * c["cr"]
    # Slopes of sideslip, yaw rate, heading and error; behind them the wheel and 1, both constant.
    slope = np.zeros((len(v), 6, 6))
    slope[:, 0, 0] = -(c["cf"] + c["cr"]) / (m * v)
    slope[:, 0, 1] = turning / (m * v**2) - 1.0
    slope[:, 0, 4] = c["cf"] / (m * v)
    slope[:, 1, 0] = turning / c["J"]
    slope[:, 1, 1] = -damping / (v * c["J"])
    slope[:, 1, 4] = c["lf"] * c["cf"] / c["J"]
    slope[:, 2, 1], slope[:, 2, 5] = 1.0, -v / radius_m
    slope[:, 3, 0], slope[:, 3, 1], slope[:, 3, 2] = v, c["ls"], v
    step = expm(slope / RATE_HZ)

    k_p, k_d, corner_rad_s = gains
    share = np.exp(-corner_rad_s / RATE_HZ)
    state, smooth = np.zeros((len(v), 6)), np.zeros(len(v))
    state[:, 5] = 1.0
    sent = deque([np.zeros(len(v))] * (max(DELAY_TICKS) + 1), max(DELAY_TICKS) + 1)
    errors = []
    for _ in range(DURATION_S * RATE_HZ):
        y = state[:, 3]
        errors.append(y)
        sent.append(-k_p * y - k_d * corner_rad_s * (y - smooth))
        smooth = share * smooth + (1.0 - share) * y
        state[:, 4] = np.where(late == 0, sent[-1], sent[0])
        state = np.einsum("nij,nj->ni", step, state)
    return np.array(errors)


@pytest.mark.usefixtures("same_process")
@pytest.mark.parametrize(("car", "radius_m"), sampled([CARS[0]], CARS))
def test_a_car_that_is_designed_is_held_in_a_simulator_written_apart(
    car: dict[str, Any], radius_m: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status = design_gains.main(written(car, radius_m, tmp_path))
    printed = capsys.readouterr()
    assert status == 0, printed.err
    preset = load_settings(ControllerSettings, None, tmp_path / "car_pd.toml").pd
    assert preset is not None
    assert preset.derivative_filter_rad_s is not None
    gains = (
        preset.proportional_gain_rad_m,
        preset.derivative_gain_rad_s_m,
        preset.derivative_filter_rad_s,
    )
    error_m = simulated_m(car, radius_m, gains)
    (said,) = (line for line in printed.out.splitlines() if line.startswith("  RMS error"))
    rms_m = np.sqrt(np.square(error_m).mean(axis=0))
    assert rms_m.max() == pytest.approx(float(said.split()[2]), rel=0.002)
    settled = np.abs(error_m[-5 * RATE_HZ :])
    assert (settled.max(axis=0) < 1.05 * settled.min(axis=0) + 1e-3).all()  # nothing swings


def test_a_sports_car_on_the_road_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """60 to 90 km/h, on a course that is gentle enough for half of that."""
    sports = {
        "vehicle": "m = 1450 J = 2100 cf = 160e3 cr = 240e3 lf = 1.35 lr = 1.2 ls = 2.0 V = 20.8",
        "speed_m_s": (60.0 / 3.6, 90.0 / 3.6),
        "virtual_mass_kg": (1300.0, 2400.0),
    }
    assert design_gains.main(written(sports, 150.0, tmp_path)) == 2
    said = capsys.readouterr().err
    assert "4.17 m/s² at 25 m/s, 0.42 of what friction 1 gives; at most 0.3" in said
    assert not (tmp_path / "car_pd.toml").exists()
