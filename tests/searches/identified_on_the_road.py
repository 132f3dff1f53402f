"""Drawn cars on the roads of the study holding_the_road, after 60 s of prescribed driving.

    python -m tests.searches.identified_on_the_road --count 4

Prints the largest deviation of each car with the predictive controller's guesses, with the car as
identified, and with the car as it is. Of every second car mass, geometry and ratio are told.
"""

import argparse
import sys
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from steer_by_wire import simulate
from steer_by_wire.closed_loop.identification.identified import identify
from steer_by_wire.closed_loop.identification.parameters import Known, car_tables
from steer_by_wire.closed_loop.identification.time_series import make_drive
from tests.support.runs.drawn_drives import drawn_car, log_of, prescribed

STUDY = tomllib.loads(Path("closed_loop/studies/holding_the_road.toml").read_text(encoding="utf-8"))
ROADS = STUDY["factors"][0]["levels"]
DELAYS_S = STUDY["factors"][1]["values"]
PRESET, SHORTEST_S = "highway_mpc", 60_000
MODEL = set(STUDY["base"]["plant"]["vehicle"])
MARGIN_S = 0.08
"""What the preset adds to the lag of the actuator of the study: play, tyres and the safe side."""


def model_of(values: Mapping[str, float], known: Known) -> dict[str, float]:
    """Return the vehicle of a set of parameters, without speed and preview."""
    vehicle, _ = car_tables(values, known)
    return vehicle.model_dump(include=MODEL)


def told(values: Mapping[str, float], known: Known) -> dict[str, Any]:
    """Return the controller's settings for a car."""
    return {
        "controller.nominal_model": model_of(values, known),
        "controller.estimator.actuator_lag_s": max(values["delay_and_lag_s"], 0.0) + MARGIN_S,
    }


def largest_m(truth: Mapping[str, float], known: Known, controller: Mapping[str, Any]) -> float:
    """Return the largest deviation of a car in all cells."""
    _, car = car_tables(truth, known)
    lag_s = float(np.sqrt(truth["lag_squared_s2"]))
    base, worst_m = STUDY["base"]["plant"], 0.0
    own = {
        "plant.safety": base["safety"],
        "plant.sensor_noise": base["sensor_noise"],
        "plant.path_ahead": {},
        "plant.actuator": {
            **base["actuator"], "lag_s": lag_s, "dead_time_s": truth["delay_and_lag_s"] - lag_s
        },
    }  # fmt: skip
    relaxation = {key: getattr(car, key) for key in ("front_relaxation_m", "rear_relaxation_m")}
    for level in ROADS.values():
        for delay_s in DELAYS_S:
            road = {
                "plant.vehicle": model_of(truth, known) | level["plant"]["vehicle"],
                "plant.car": relaxation | level["plant"]["car"],
                "plant.path": level["plant"]["path"],
                "plant.latency.downlink.mean_s": delay_s,
            }
            run = simulate(
                "highway_nominal",
                PRESET,
                duration_s=12.0,
                engine="compiled",
                overrides=own | road | controller,
            )
            worst_m = max(worst_m, run.peak_m)
    return worst_m


def one_car(seed: int) -> tuple[float, float, float]:
    """Return the largest deviations by guess, by identification and by truth."""
    rng = np.random.default_rng(seed)
    truth = drawn_car(rng)
    drive = (one[:SHORTEST_S] for one in prescribed(truth))
    drawn = log_of(truth, *drive, rng, knows=seed % 2 == 0, network=(0.002, 0.01))
    found = identify(make_drive(drawn.channels, f"car {seed}"), drawn.known, is_brief=True).found
    known = drawn.known
    return (
        largest_m(truth, known, {}),
        largest_m(truth, known, told(found.values, known)),
        largest_m(truth, known, told(truth, known)),
    )


def main(arguments: list[str]) -> None:
    """Print a row of each car."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=4)
    options = parser.parse_args(arguments)
    for seed in range(options.first, options.first + options.count):
        guess_m, found_m, truth_m = one_car(seed)
        sys.stdout.write(
            f"{seed}: guess {guess_m:.2f} m, identified {found_m:.2f}, true {truth_m:.2f}\n"
        )
        sys.stdout.flush()


if __name__ == "__main__":
    main(sys.argv[1:])
