"""Short logs of our own runs, identified: how often each interval holds the plant's parameter.

    python -m tests.searches.short_logs [FIRST COUNT FILE]

A run in virtual time is of a drawn preset with a car, controller, path, speed and network, and
lasts 10 to 40 s. Every second one has noise on its yaw rate; of every third the car's mass,
geometry and driven axle are told. The words are as those of ``hidden_cars``.
"""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from steer_by_wire.closed_loop.identification.bus_series import read_bus
from steer_by_wire.closed_loop.identification.parameters import Known, values_of
from steer_by_wire.controller.laws.law_from_settings import required
from steer_by_wire.dbc.bus_language import BusLanguage
from steer_by_wire.plant_emulator.settings import PRESETS, PlantSettings
from steer_by_wire.runtime.settings import load_settings, read_preset
from steer_by_wire.tools.run.__main__ import main as run
from tests.searches.hidden_cars import Row, search, table, told
from tests.searches.ordinary_runs import path_of

CARS = (
    "bmw_320i", "city_bus", "ford_escort", "honda_civic", "hyundai_ioniq_5", "large_sedan",
    "toyota_prius", "truck", "vw_vanagon",
)  # fmt: skip
CONTROLLERS = ("highway_pd", "highway_pd_ddob", "highway_predictor")


def drawn_settings(rng: np.random.Generator, seed: int) -> dict[str, Any]:
    """Draw what a run sets of its plant."""
    settings: dict[str, Any] = {"seed": seed, "duration_s": rng.uniform(10.0, 40.0)}
    settings["vehicle.speed_m_s"] = rng.uniform(10.0, 22.0)
    settings["sensor_noise.yaw_rate_rad_s"] = rng.uniform(5e-4, 4e-3) * (seed % 2)
    if rng.random() < 0.8:
        path = path_of(rng, is_fast=True)["plant.path"]
        settings |= {f"path.{key}": value for key, value in path.items()}
    for way, mean_s in (("downlink", rng.uniform(0.0, 0.08)), ("uplink", rng.uniform(0.0, 0.04))):
        spread_s, loss = mean_s * rng.uniform(0.05, 0.4), rng.uniform(0.0, 0.05)
        latency = {"model": "gamma", "mean_s": mean_s, "spread_s": spread_s, "loss": loss}
        settings |= {f"latency.{way}.{key}": value for key, value in latency.items()}
    return settings


def one_log(seed: int) -> Row:
    """Return the row of a run."""
    rng = np.random.default_rng([60, seed])
    preset, controller = str(rng.choice(CARS)), str(rng.choice(CONTROLLERS))
    settings = drawn_settings(rng, seed)
    plant = load_settings(PlantSettings, read_preset(PRESETS, preset))
    vehicle, car = plant.vehicle, required(plant.car)
    words = [word for key, it in settings.items() for word in ("--set", f"plant.{key}={it}")]
    with TemporaryDirectory() as folder:
        run(["--preset", preset, "--preset", controller, *words, "--out", folder])
        channels = read_bus([Path(folder) / "candump.log"], BusLanguage()).channels
    # A plant samples its wheel and its yaw rate at one time.
    zero = "steering_offset_rad", "yaw_rate_offset_rad_s", "delay_and_lag_s", "lag_squared_s2"
    truth = values_of(vehicle, car) | dict.fromkeys(zero, 0.0) | {"steering_ratio": 1.0}
    known = Known()
    if seed % 3 == 0:
        known = Known(
            mass_kg=vehicle.virtual_mass_kg, wheelbase_m=truth["wheelbase_m"],
            **vehicle.model_dump(include={"yaw_inertia_kg_m2", "front_axle_distance_m"}),
            **car.model_dump(include={"cg_height_m", "drive_front"}),
        )  # fmt: skip
    row = {"seed": seed, "preset": preset, "controller": controller, **settings}
    return row | told(channels, truth, known)


if __name__ == "__main__":
    search(one_log, table, "0", "40", "short_logs.jsonl")
