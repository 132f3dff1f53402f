"""The last sentence of a run is true: drawn runs, and a simple judge that shares nothing with ours.

It knows the motion of path and wheel alone, by peaks, means and reversals.
"""

import re
from typing import Any

import numpy as np
import pytest

from steer_by_wire import Run, controller_presets, plant_presets, simulate
from steer_by_wire.plant_emulator.evaluation.report_in_words import verdict_text
from tests.support.suite.combinations import sampled

SEED = 55
SAMPLE = (0, 3, 5, 6, 7, 9, 12, 13, 14, 24, 26, 29, 32, 37)
"""With each verdict that is among all."""
DELAYS_S = (0.0, 0.02, 0.08, 0.16, 0.25, 0.35, 0.45, 0.55)
NOISES_M = (0.0, 0.0, 0.002, 0.01, 0.02)
DURATIONS_S = (4.0, 8.0, 15.0, 20.0, 30.0)
SETTLED_S, OFF_M, ROAD_M = 5.0, 0.25, 1.75


def drawn(number: int) -> Run:
    """Return a run of any laws, vehicles, networks, disturbances and lengths."""
    rng = np.random.default_rng([SEED, number])
    controller = str(rng.choice(controller_presets()))
    fast = [name for name in plant_presets() if name.startswith("highway")]
    slow = [name for name in plant_presets() if name.startswith("paper")]
    plant = str(rng.choice(fast if controller.startswith("highway") else slow))
    overrides: dict[str, Any] = {
        "plant.latency.downlink.mean_s": float(rng.choice(DELAYS_S)),
        "plant.sensor_noise.lateral_error_m": float(rng.choice(NOISES_M)),
        "plant.actuator.lag_s": float(rng.choice([0.0, 0.0, 0.1, 0.27])),
        "plant.latency.downlink.loss": float(rng.choice([0.0, 0.0, 0.05, 0.2])),
    }
    if rng.random() < 0.4:
        push = {
            "at_s": float(rng.choice([2.0, 8.0, 14.0])),
            "steering_offset_rad": float(rng.choice([0.02, 0.05, 0.15])),
        }
        overrides["plant.disturbance.steps"] = [push]
    if controller.startswith("paper"):
        overrides["plant.sensor_period_ms"] = 1.0
    duration_s = float(rng.choice(DURATIONS_S))
    duration_s = min(duration_s, 8.0) if controller.startswith("paper") else duration_s
    return simulate(plant, controller, seed=number, duration_s=duration_s, overrides=overrides)


def reversals(values: Any, least: float) -> int:
    """Return how often a signal turns back by at least so much."""
    count, low, high, rises = 0, values[0], values[0], True
    for value in values:
        low, high = min(low, value), max(high, value)
        if (rises and high - value >= least) or (not rises and value - low >= least):
            count, rises, low, high = count + 1, not rises, value, value
    return count


def figure(text: str, pattern: str) -> float:
    """Return a length in the sentence [m]."""
    found = re.search(pattern.replace("LENGTH", r"(\d+\.\d+) (mm|m)\b"), text)
    assert found, text
    return float(found[1]) * (1e-3 if found[2] == "mm" else 1.0)


@pytest.mark.parametrize("number", sampled(SAMPLE, range(40)))
def test_the_last_sentence_is_true(number: int) -> None:
    run = drawn(number)
    text = verdict_text(run.plant_report)
    time_s, wheel_rad = run.plant.time_s, run.plant.wheel_angle_rad
    error_m = run.plant.cg_deviation_m
    length_s = min(15.0, 0.25 * time_s[-1])
    last = time_s > time_s[-1] - length_s
    before = (time_s > time_s[-1] - 2.0 * length_s) & ~last
    peak_m, settled_m, end_m, before_m = (
        float(np.max(np.abs(error_m[part]), initial=0.0))
        for part in (time_s >= 0.0, time_s > SETTLED_S, last, before)
    )
    verdict = text.partition(":")[0]
    if verdict == "holds":
        assert max(settled_m, end_m) <= OFF_M
        assert peak_m <= ROAD_M
        assert reversals(wheel_rad[last], 0.4) <= 2.0 * length_s
        assert figure(text, "at most LENGTH off") == pytest.approx(end_m, rel=0.05, abs=2e-3)
        assert figure(text, "LENGTH in the whole run") == pytest.approx(peak_m, rel=0.01, abs=1e-3)
    elif verdict in ("limit cycle", "unstable"):
        swing_m = figure(text, "swings of ±LENGTH")
        turns = (
            reversals(error_m[last | before], 0.5 * swing_m),
            reversals(wheel_rad[last | before], 0.015),
        )
        assert max(turns) >= 3
    elif verdict == "drifts":
        assert abs(error_m[last].mean()) > abs(error_m[before].mean())
        assert end_m > OFF_M
    elif verdict == "left road":
        assert peak_m > ROAD_M
    elif verdict == "decays":
        assert end_m < before_m
    elif verdict == "off path":
        assert end_m > OFF_M or np.ptp(error_m[last]) > 0.1
    elif verdict == "left path":
        assert settled_m > OFF_M >= end_m
    elif verdict == "wheel shakes":
        assert np.std(wheel_rad[last]) > 0.1
        assert end_m <= OFF_M
    else:
        assert verdict == "left range"
        assert peak_m > 80.0
