"""Whether ``highway_mpc_asking`` asks to slow down where it has to, and nowhere else.

    python -m tests.searches.asking_to_slow_down

The cells of the study holding_the_road, and 40 drawn lane changes at 0.3 to 1.6 of the grip,
with the car as known and one 20 % heavier and softer; the friction is known, and the path 3 s
ahead. A request is false where the same law, with the true model and without asking, stays within
0.3 m; one is missed where that law does not, and none came.
"""

import math
import sys
from collections import Counter
from collections.abc import Iterator, Mapping
from itertools import product
from typing import Any

import numpy as np

from steer_by_wire import simulate
from tests.system.loop.test_holding_the_road import STUDY, plant_of

SEED, BENDS, OFF_M = 1, 40, 0.3
PRESET, SHARE, GRAVITY_M_S2, DURATION_S = "highway_mpc_asking", 0.9, 9.81, 12.0
OFF = STUDY["base"]["variants"]["mpc + path, heavy and soft"]["plant"]["vehicle"]
KINDS = (("not asked", "missed"), ("false", "asked"))
"""By whether a car was asked to slow down, and whether it had to be."""


def judged(plant: Mapping[str, Any], *, is_off: bool) -> tuple[str, float]:
    """Return of which kind the request to a plant is, and how far its car is off [m]."""
    vehicle = plant["plant.vehicle"] | (OFF if is_off else {})
    grip_m_s2 = plant["plant.car"]["friction"] * GRAVITY_M_S2
    noise = STUDY["base"]["plant"]["sensor_noise"]
    overrides = {
        **plant,
        "plant.vehicle": vehicle,
        "plant.path_ahead": {"reach_s": 3.0},
        **{f"plant.sensor_noise.{key}": value for key, value in noise.items()},
        "controller.predictor.lateral_acceleration_m_s2_max": SHARE * grip_m_s2,
    }
    true = {f"controller.nominal_model.{key}": OFF[key] for key in OFF if is_off}
    asking, knowing = (
        simulate("highway_nominal", PRESET, duration_s=DURATION_S, seed=SEED, overrides=each)
        for each in (overrides, {**overrides, **true, "controller.mpc.asks_to_slow_down": False})
    )
    both = min(len(run.plant.time_s) for run in (asking, knowing)) - 1
    slow_m, fast_m = (run.plant.arc_length_m[both] for run in (asking, knowing))
    is_asked = bool(slow_m < 0.999 * fast_m)  # what a bend itself brakes, brakes both
    is_needed = knowing.outcome != "complete" or knowing.peak_m > OFF_M
    off_m = asking.peak_m if asking.outcome == "complete" else math.inf
    return KINDS[is_asked][is_needed], off_m


def cells() -> Iterator[tuple[str, dict[str, Any], bool]]:
    """Yield the name, plant and car of each cell."""
    roads, latencies_s = STUDY["factors"][0]["levels"], STUDY["factors"][1]["values"]
    for road, latency_s, is_off in product(roads, latencies_s, (False, True)):
        yield f"{road}, {1e3 * latency_s:g} ms", plant_of(road, latency_s), is_off


def drawn() -> Iterator[tuple[str, dict[str, Any], bool]]:
    """Yield the same of lane changes, every second one of the other car."""
    draw = np.random.default_rng(SEED)
    for number in range(BENDS):
        friction, speed_m_s = draw.uniform(0.3, 1.0), draw.uniform(14.0, 27.8)
        share, latency_s = draw.uniform(0.3, 1.6), draw.uniform(0.0, 0.2)
        plant = plant_of("μ 1, 80 km/h", latency_s)
        peak_1_m = share * friction * GRAVITY_M_S2 / speed_m_s**2
        change = {"start_m": 3.0 * speed_m_s, "length_m": math.sqrt(27.8 / peak_1_m)}
        plant["plant.path"] = {**plant["plant.path"], **change}
        plant["plant.car"] = {**plant["plant.car"], "friction": friction}
        plant["plant.vehicle"] = {**plant["plant.vehicle"], "speed_m_s": speed_m_s}
        yield f"{share:.2f} of the grip, μ {friction:.2f}", plant, bool(number % 2)


def main() -> None:
    """Print what was false, missed or far off, and the counts."""
    for title, drives in (("cells", cells()), ("drawn", drawn())):
        kinds = Counter[str]()
        for name, plant, is_off in drives:
            kind, off_m = judged(plant, is_off=is_off)
            kinds[kind] += 1
            if kind in ("false", "missed") or off_m > OFF_M:
                sys.stdout.write(f"{name}, 20 % off {is_off}: {kind}, {off_m:.2f} m off\n")
        sys.stdout.write(f"{title}: {dict(kinds)}\n")


if __name__ == "__main__":
    main()
