"""The study holding_the_road, checked against a car that shares no line with the plant."""

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

from steer_by_wire import SettingsError, simulate
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.plant_emulator.evaluation.report_in_words import plant_summary
from tests.support.loops.own_car import lane_change, largest_deviation_m

STUDY = tomllib.loads(Path("closed_loop/studies/holding_the_road.toml").read_text(encoding="utf-8"))
DURATION_S = 7.0


def plant_of(road: str, latency_s: float) -> dict[str, Any]:
    """Return the study's plant on one of its roads, without noise."""
    level = STUDY["factors"][0]["levels"][road]["plant"]
    base: dict[str, Any] = STUDY["base"]["plant"]
    return {
        **{f"plant.{key}": base[key] for key in ("actuator", "safety")},
        "plant.vehicle": {**base["vehicle"], **level["vehicle"]},
        "plant.car": {**base["car"], **level["car"]},
        "plant.path": level["path"],
        "plant.latency.downlink.mean_s": latency_s,
    }


@pytest.mark.parametrize(
    ("preset", "road", "latency_s"),
    [
        ("highway_unknown_path_predictor", "μ 1, 60 km/h", 0.2),
        ("highway_mpc", "μ 1, 80 km/h", 0.0),
        ("highway_mpc", "μ 0.5, 100 km/h", 0.2),
        ("highway_unknown_path_predictor", "μ 0.3, 60 km/h", 0.2),
    ],
)
def test_a_car_written_apart_is_as_far_off(preset: str, road: str, latency_s: float) -> None:
    """Within a tenth and a centimetre."""
    plant = plant_of(road, latency_s)
    speed_m_s, path = plant["plant.vehicle"]["speed_m_s"], plant["plant.path"]
    friction = plant["plant.car"]["friction"]
    run = simulate("highway_nominal", preset, duration_s=DURATION_S, overrides=plant)
    other_m = largest_deviation_m(
        controller_preset(preset),
        lane_change(path["start_m"], path["offset_m"], 0.5 * friction * 9.81 / speed_m_s**2),
        speed_m_s,
        friction,
        latency_s,
        DURATION_S,
    )
    assert run.peak_m > 0.03
    assert abs(run.peak_m - other_m) <= 0.1 * other_m + 0.01


@pytest.mark.parametrize("road", ["μ 0.5, 80 km/h", "μ 0.3, 100 km/h"])
def test_the_default_limits_leave_half_the_grip_of_a_wet_road(road: str) -> None:
    """At 200 ms, with noise and without play."""
    plant = {key: it for key, it in plant_of(road, 0.2).items() if key != "plant.safety"}
    noise = STUDY["base"]["plant"]["sensor_noise"]
    plant |= {"plant.actuator.dead_band_rad": 0.0, "plant.path_ahead": {}}
    plant |= {f"plant.sensor_noise.{key}": value for key, value in noise.items()}
    plant |= {"controller.predictor.lateral_acceleration_m_s2_max": 3.0}
    run = simulate(
        *("highway_nominal", "highway_mpc"),
        duration_s=DURATION_S, engine="compiled", overrides=plant,
    )  # fmt: skip
    assert 0.02 < run.peak_m < 0.15


def test_a_bend_beyond_the_grip_is_held_by_slowing_down() -> None:
    """A lane change at twice the grip, known 3 s ahead: at its speed the car spins."""
    plant = plant_of("μ 0.3, 100 km/h", 0.2)
    plant["plant.path"] = {**plant["plant.path"], "length_m": 60.0}
    plant |= {
        "plant.path_ahead": {"reach_s": 3.0},
        "controller.predictor.lateral_acceleration_m_s2_max": 0.85 * 0.3 * 9.81,
    }
    slides, slows = (
        simulate("highway_nominal", preset, duration_s=12.0, overrides=plant)
        for preset in ("highway_mpc", "highway_mpc_asking")
    )
    assert "the car has left its path" in slides.outcome
    assert "the path asks for" in repr(slides)
    assert "speed" not in dict(plant_summary(slides.plant_report))
    said = dict(plant_summary(slows.plant_report))["speed"]
    assert re.fullmatch(r"the controller asked to slow down to (1\d|2[0-6])\.\d m/s", said)
    assert slows.peak_m < 0.3
    with pytest.raises(SettingsError, match="asks to slow down, which compiled runs do not carry"):
        simulate("highway_nominal", "highway_mpc_asking", engine="compiled", overrides=plant)
