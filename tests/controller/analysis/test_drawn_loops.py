"""Drawn loops: stable is what decays by a computation that shares no line with the analysis.

A loop is a law, its rate and the sensors', its gains, a nominal vehicle from 0.6 to 14 t, another
vehicle that is driven, a lag of the wheel and a latency of the measurements. It is asked at a drawn
delay, and half to four per cent beside every limit of stability that the analysis finds.
"""

import math
from typing import Any

import numpy as np
import pytest

from steer_by_wire.controller.analysis.check_figures import Loop, loop_around
from steer_by_wire.controller.analysis.loop_signals import LoopModel
from steer_by_wire.controller.analysis.periodic_loop import PeriodicLoop
from steer_by_wire.controller.analysis.sampled_loop import SLOWEST_DECAY_1_S
from steer_by_wire.controller.analysis.stable_delays import RESOLUTION_NS, stable_delays
from steer_by_wire.controller.filters.nominal_model import NominalVehicle
from steer_by_wire.controller.laws.law_from_settings import design_law
from steer_by_wire.controller.settings import ControllerSettings
from tests.support.loops.loop_written_apart import OBSERVERS, decay_1_s
from tests.support.suite.combinations import sampled

RATES_HZ = (25.0, 50.0, 100.0, 125.0, 200.0, 250.0, 500.0, 1000.0)
SENSORS_MS = (1.0, 2.0, 4.0, 5.0, 8.0, 10.0, 20.0)
LIMIT_NS = 400_000_000
TICKS_MAX = {True: 200, False: 25}
"""Control periods of delay that are searched, of one rate and of two: of those each takes 30 ms."""
DRIVEN = ("virtual_mass_kg", "front_cornering_stiffness_n_rad", "speed_m_s")


def drawn_vehicle(rng: np.random.Generator) -> dict[str, float]:
    """Draw anything between a city car and a bus, mostly understeering."""
    mass, speed = np.exp(rng.uniform(np.log([600.0, 0.8]), np.log([14000.0, 25.0]))).tolist()
    front = rear = rng.uniform(0.4, 0.6) * (2.0 + mass / 3500.0)
    load_n = mass * 9.81 / (front + rear)
    return {
        "virtual_mass_kg": mass,
        "yaw_inertia_kg_m2": mass * front * rear * rng.uniform(0.7, 1.3),
        "front_cornering_stiffness_n_rad": rng.uniform(6.0, 14.0) * load_n * rear,
        "rear_cornering_stiffness_n_rad": rng.uniform(9.0, 20.0) * load_n * front,
        "front_axle_distance_m": front,
        "rear_axle_distance_m": rear,
        "preview_distance_m": rng.uniform(1.0, 4.0),
        "speed_m_s": speed,
    }


def drawn_settings(law: str, rng: np.random.Generator) -> dict[str, Any]:
    """Draw gains for a bandwidth ω of 0.3 to 6 rad/s, and rates, of which few loops have two."""
    rate_hz, sensor_ms = float(rng.choice(RATES_HZ)), float(rng.choice(SENSORS_MS))
    while (1e3 / rate_hz) % sensor_ms and rng.random() > 0.1:
        rate_hz, sensor_ms = float(rng.choice(RATES_HZ)), float(rng.choice(SENSORS_MS))
    model, w = drawn_vehicle(rng), math.exp(rng.uniform(math.log(0.3), math.log(6.0)))
    length_m = model["front_axle_distance_m"] + model["rear_axle_distance_m"]
    w_per_gain = w * length_m / model["speed_m_s"] ** 2
    k_p = rng.uniform(0.1, 1.0) * w * w_per_gain
    gains = k_p, rng.uniform(0.0, 1.5) * w_per_gain, rng.uniform(3.0, 60.0)
    names = ("proportional_gain_rad_m", "derivative_gain_rad_s_m", "derivative_filter_rad_s")
    cutoff, washout = ({"q_cutoff_rad_s": w * rng.uniform(0.2, 2.0)} for _ in range(2))
    washout["washout_rad_s"] = w * rng.uniform(0.1, 1.0)
    tables: dict[str, Any] = {
        "dob": {**cutoff, "q_kind": str(rng.choice(["order_2", "type_2"]))},
        "cdob": washout,
        "smith": {
            "delay_s": rng.uniform(0.0, 0.4), "washout_rad_s": washout["washout_rad_s"],
        },
        "pid": {
            "integral_gain_rad_m_s": k_p * w * rng.uniform(0.03, 0.4),
            "heading_gain_rad_rad": rng.uniform(0.0, 1.0) * w_per_gain * model["speed_m_s"],
        },
    }  # fmt: skip
    return {
        "law": law,
        "rate_hz": rate_hz,
        "pd": dict(zip(names[: 2 + (rng.random() < 0.7)], gains, strict=False)),  # some no filter
        "link": {"sensor_period_ms": sensor_ms},
        "nominal_model": {"kind": "vehicle", **model},
        **{name: tables[name] for name in OBSERVERS.get(law, (law,)) if name in tables},
    }


@pytest.mark.parametrize("law", ["pd", *OBSERVERS, "pid", "smith"])
@pytest.mark.parametrize("seed", sampled(range(4), range(100)))
def test_what_is_called_stable_decays_and_what_is_not_does_not(law: str, seed: int) -> None:
    rng = np.random.default_rng([40, seed, *law.encode()])
    s = drawn_settings(law, rng)
    lag_s = 0.0 if rng.random() < 0.8 else rng.uniform(0.02, 0.4)
    uplink_ns = 0 if rng.random() < 0.8 else round(1e6 * rng.uniform(0.1, 40.0))
    driven = {key: value for key, value in s["nominal_model"].items() if key != "kind"}
    for key in DRIVEN:
        driven[key] *= rng.uniform(0.7, 1.4)
    vehicle, settings = NominalVehicle(**driven), ControllerSettings.model_validate(s)
    loop: Loop = loop_around(settings, vehicle, {})
    if lag_s or uplink_ns:
        model = LoopModel(vehicle, lag_s, uplink_ns)
        loop = PeriodicLoop(design_law(settings), settings.loop_delay, model)
    limit_ns = min(LIMIT_NS, TICKS_MAX[not isinstance(loop, PeriodicLoop)] * settings.period_ns)
    stable = stable_delays(loop, limit_ns)
    ends = sorted({end for each in stable for end in each} - {0, limit_ns})
    beside = [end * (1.0 + side * rng.uniform(0.005, 0.04)) for end in ends for side in (-1, 1)]
    for delay_ns in map(round, (*beside, rng.uniform(0.0, limit_ns))):
        if delay_ns < limit_ns and all(abs(delay_ns - end) >= RESOLUTION_NS for end in ends):
            is_stable = any(first <= delay_ns <= last for first, last in stable)
            decay = decay_1_s(s, driven, delay_ns, lag_s, uplink_ns)
            assert is_stable == (decay > SLOWEST_DECAY_1_S), (delay_ns, decay)
