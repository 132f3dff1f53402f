"""The study holding_the_road, checked against a car that shares no line with the plant."""

import tomllib
from pathlib import Path
from typing import Any

import pytest

from steer_by_wire import simulate
from steer_by_wire.controller.settings import controller_preset
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
        ("highway_predictor", "μ 1, 60 km/h", 0.2),
        ("highway_mpc", "μ 1, 80 km/h", 0.0),
        ("highway_mpc", "μ 0.5, 100 km/h", 0.2),
        ("highway_predictor", "μ 0.3, 60 km/h", 0.2),
    ],
)
def test_another_car_is_as_far_off_within_a_tenth_and_a_centimetre(
    preset: str, road: str, latency_s: float
) -> None:
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
    assert run.peak_m == pytest.approx(other_m, rel=0.1, abs=0.01)
