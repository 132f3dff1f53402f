"""The grip is named where it was used up before the lane was left, and nowhere else: drawn runs."""

import math
from collections import Counter
from typing import Any

import numpy as np
import pytest

from steer_by_wire import Run, simulate
from steer_by_wire.closed_loop.compiled.engine import run_compiled
from steer_by_wire.closed_loop.studies.compiled_runs import figures_on
from steer_by_wire.plant_emulator.evaluation.report_in_words import verdict_text
from steer_by_wire.plant_emulator.path.drivability import GRAVITY_M_S2
from tests.support.suite.combinations import sampled

STEP_S = 0.001
"""Of the car: the trace has every step, so Newton's law gives the forces that acted in it."""
# So that nothing but the tyres' side forces moves the car: its load stays where it is as well.
SIDE_ALONE = (
    *("cg_height_m", "drag_n_s2_m2", "rolling_resistance"),
    *("drive_force_n_max", "brake_force_n_max"),
)


def drawn_run(seed: int) -> Run:
    """Return a lane change that takes some of the grip, or more."""
    draw = np.random.default_rng(seed)
    friction, speed_m_s = draw.uniform(0.3, 1.0), draw.uniform(14.0, 30.0)
    peak_1_m = draw.uniform(0.2, 1.4) * friction * GRAVITY_M_S2 / speed_m_s**2
    change = {"start_m": speed_m_s, "offset_m": 3.5, "length_m": math.sqrt(20.2 / peak_1_m)}
    return simulate(
        "bmw_320i",
        str(draw.choice(["highway_pd", "highway_stiff_predictor"])),
        duration_s=draw.uniform(3.0, 5.0),
        latency_s=draw.uniform(0.0, 0.2),
        overrides={
            "plant.sensor_period_ms": 1,
            "plant.vehicle.speed_m_s": speed_m_s,
            "plant.path": {"kind": "single_lane_change", **change},
            "plant.car.tyre": str(draw.choice(["fiala", "magic_formula"])),
            "plant.car.friction": friction,
            **{f"plant.car.{key}": 0.0 for key in SIDE_ALONE},
            "plant.safety.lateral_acceleration_m_s2_max": "off",
            "plant.safety.lateral_jerk_m_s3_max": "off",
        },
    )


def use_by_newton(run: Run) -> Any:
    """Return what each axle gives over μ F_z in each step but the last, shape (2, samples - 1)."""
    trace, vehicle = run.plant, run.plant_settings.vehicle
    front_m, rear_m = vehicle.front_axle_distance_m, vehicle.rear_axle_distance_m
    turn_rad_s, tan_slip = trace.yaw_rate_rad_s, np.tan(trace.side_slip_rad)
    u, used = vehicle.speed_m_s, []
    for k, wheel_rad in enumerate(trace.wheel_angle_rad[1:]):
        v, r = u * tan_slip[k], turn_rad_s[k]
        side_n = vehicle.virtual_mass_kg * ((u * tan_slip[k + 1] - v) / STEP_S + u * r)
        moment_n_m = vehicle.yaw_inertia_kg_m2 * (turn_rad_s[k + 1] - r) / STEP_S
        front_n = (rear_m * side_n + moment_n_m) / (front_m + rear_m)
        used.append((abs(front_n / math.cos(wheel_rad)) / rear_m, abs(side_n - front_n) / front_m))
        u += STEP_S * (v * r - front_n * math.tan(wheel_rad) / vehicle.virtual_mass_kg)
    friction = run.plant_settings.model_dump()["car"]["friction"]
    weight_n = vehicle.virtual_mass_kg * GRAVITY_M_S2
    return np.array(used).T * (front_m + rear_m) / (weight_n * friction)


def found(seed: int) -> str:
    """Return what a drawn run is an example of, after the assertions on it."""
    run = drawn_run(seed)
    plant, used, named = run.plant_settings, use_by_newton(run), run.plant_report["grip_used"]
    compiled = run_compiled(plant, run.controller_settings)
    has_spun = "the car has left its path" in run.outcome
    for text in (verdict_text(run.plant_report), *([run.outcome] if has_spun else [])):
        assert ("used up their grip" in text) == (named is not None)
    studied_s = figures_on(plant.verdict, plant, run.controller_settings, compiled).grip_used_s
    assert studied_s == pytest.approx(named["from_s"] if named else math.nan, nan_ok=True)
    assert plant.car is not None
    is_beyond = compiled.beyond_lane_m(plant.car.lane) > 0.0
    if not is_beyond.any():
        assert named is None
        return "in its lane"
    peaks = used[:, : np.argmax(is_beyond)].max(axis=1, initial=0.0)
    if np.any(np.abs(peaks - 0.99) < 0.004):
        return "between"
    if peaks.max() < 0.99:
        assert (named and named["left"]) == ("path" if has_spun else None)
        return "off it with grip"
    assert named is not None
    assert named["left"] == "lane"
    for axle, peak, use in zip(("front", "rear"), peaks, used, strict=True):
        assert (axle in named) == (peak > 0.99)
        if axle in named:
            first = round(named[axle]["from_s"] / STEP_S)
            assert use[:first].max() < 0.994
            assert use[first] > 0.986
    return "off it without"


@pytest.mark.parametrize("first", sampled([0], list(range(0, 200, 10))))
def test_the_grip_is_named_if_and_only_if_it_was_used_up_before(first: int) -> None:
    kinds = Counter(map(found, range(first, first + 10)))
    assert kinds["in its lane"] > 1
    assert kinds["off it with grip"] > 1
    assert kinds["off it without"] > 0
    assert kinds["between"] < 4
