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
from steer_by_wire.plant_emulator.path.cg_deviation import cg_deviation_m
from steer_by_wire.plant_emulator.path.corridor import beyond_lane_m
from steer_by_wire.plant_emulator.path.drivability import GRAVITY_M_S2
from steer_by_wire.plant_emulator.path.path_from_settings import build_path
from tests.support.suite.combinations import sampled

STEP_S = 0.001
"""Of the car: the trace has every step, so Newton's law gives the forces that acted in it."""
# So that nothing but the tyres' side forces moves the car: its load stays where it is as well.
SIDE_ALONE = {"cg_height_m": 0.0, "drag_n_s2_m2": 0.0, "rolling_resistance": 0.0}


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
        overrides={
            "plant.sensor_period_ms": 1,
            "plant.latency.downlink.mean_s": draw.uniform(0.0, 0.2),
            "plant.vehicle.speed_m_s": speed_m_s,
            "plant.path": {"kind": "single_lane_change", **change},
            "plant.car.tyre": str(draw.choice(["fiala", "magic_formula"])),
            "plant.car.friction": friction,
            "plant.car.drive_force_n_max": 0.0,
            "plant.car.brake_force_n_max": 0.0,
            **{f"plant.car.{key}": value for key, value in SIDE_ALONE.items()},
            "plant.safety.lateral_acceleration_m_s2_max": "off",
            "plant.safety.lateral_jerk_m_s3_max": "off",
        },
    )


def use_by_newton(run: Run) -> Any:
    """Return what each axle gives over μ F_z in each step but the last, shape (2, samples - 1)."""
    trace, settings = run.plant, run.plant_settings
    vehicle, friction = settings.vehicle, settings.car.friction if settings.car else math.nan
    mass_kg, inertia = vehicle.virtual_mass_kg, vehicle.yaw_inertia_kg_m2
    front_m, rear_m = vehicle.front_axle_distance_m, vehicle.rear_axle_distance_m
    turn_rad_s, tan_slip = trace.yaw_rate_rad_s, np.tan(trace.side_slip_rad)
    u, used = vehicle.speed_m_s, []
    for k, wheel_rad in enumerate(trace.wheel_angle_rad[1:]):
        v, r = u * tan_slip[k], turn_rad_s[k]
        side_n = mass_kg * ((u * tan_slip[k + 1] - v) / STEP_S + u * r)
        moment_n_m = inertia * (turn_rad_s[k + 1] - r) / STEP_S
        front_n = (rear_m * side_n + moment_n_m) / (front_m + rear_m)
        rear_n = side_n - front_n
        used.append((abs(front_n / math.cos(wheel_rad)) / rear_m, abs(rear_n) / front_m))
        u += STEP_S * (v * r - front_n * math.tan(wheel_rad) / mass_kg)
    return np.array(used).T * (front_m + rear_m) / (mass_kg * GRAVITY_M_S2 * friction)


def samples_in_lane(run: Run) -> int:
    """Return how many samples there are before a corner of the body is beyond its lane."""
    trace, settings = run.plant, run.plant_settings
    assert settings.car is not None
    path = build_path(settings.path)
    lane, preview_m = settings.car.lane, settings.vehicle.preview_distance_m
    at = trace.arc_length_m, trace.heading_error_rad, trace.lateral_error_m
    rear_m = [
        cg_deviation_m(path, *place, preview_m + lane.rear_m)
        for place in zip(*(column.tolist() for column in at), strict=True)
    ]
    off_m = beyond_lane_m(lane, preview_m, *at[1:], trace.curvature_1_m, np.array(rear_m))
    return int(np.argmax(off_m > 0.0)) if np.any(off_m > 0.0) else len(off_m)


def found(seed: int) -> str:
    """Return what a drawn run is an example of, after the assertions on it."""
    run = drawn_run(seed)
    used, inside = use_by_newton(run), samples_in_lane(run)
    named = run.plant_report["grip_used"]
    has_spun = "the car has left its path" in run.outcome
    for text in (verdict_text(run.plant_report), *([run.outcome] if has_spun else [])):
        assert ("used up their grip" in text) == (named is not None)
    plant, controller = run.plant_settings, run.controller_settings
    studied = figures_on(plant, controller, run_compiled(plant, controller))
    assert studied.grip_used_s == pytest.approx(named["from_s"] if named else math.nan, nan_ok=True)
    if inside == len(run.plant.time_s):
        assert named is None
        return "in its lane"
    peaks = used[:, :inside].max(axis=1, initial=0.0)
    if np.any(np.abs(peaks - 0.99) < 0.004):
        return "between"
    if peaks.max() < 0.99:
        assert (named is not None) == has_spun
        assert named is None or named["left"] == "path"
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
