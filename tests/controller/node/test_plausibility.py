"""Contradictions of the plant's signals: by hand, with faults no CRC shows, without any."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire import Run, VehicleModel, simulate
from steer_by_wire import VehicleState as VehicleMotion
from steer_by_wire.controller.filters.nominal_model import understeer_gradient_s2_m
from steer_by_wire.controller.node.plausibility import (
    BOUNDS,
    OPPOSED_S,
    Plausibility,
    Reported,
    mean_motion,
    nominal_vehicle,
)
from steer_by_wire.controller.node.report_in_words import controller_summary
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.dbc.messages import VehicleState
from tests.support.frames.made_messages import motion_of

SPEED_M_S = 2.0
STEP_S = 0.1
ONSET_S = 3.0
FARTHEST_M = 8.0
NOISE: dict[str, Any] = {
    "plant.sensor_noise.lateral_error_m": 0.01,
    "plant.sensor_noise.heading_error_rad": 0.002,
    "plant.sensor_noise.yaw_rate_rad_s": 0.005,
    "plant.latency.downlink.mean_s": 0.08,
    "plant.latency.uplink.mean_s": 0.03,
}


# By hand: an angle of the path that turns at V ρ, and a vehicle that turns with it


def contradiction_after(turned_s: float, curvature_factor: float) -> str:
    """Return what is found of a turn of 0.1 1/m whose curvature is reported with a factor."""
    watch = Plausibility(None, has_plans=True)
    curvature_1_m = 0.1
    for _ in range(round(turned_s / STEP_S) + 1):
        told_1_m = curvature_factor * curvature_1_m
        state = motion_of(SPEED_M_S, SPEED_M_S * curvature_1_m, told_1_m)
        watch.step(mean_motion([(state, 0.0, 0.0, 0.0)], STEP_S), 0.0, 0.0, 0.0)
    return watch.contradiction


def test_a_turn_with_its_own_curvature_is_plausible_for_ever() -> None:
    assert contradiction_after(100.0, 1.0) == ""


def test_a_curvature_of_the_wrong_sign_is_found_after_the_debounce_and_not_before() -> None:
    assert contradiction_after(OPPOSED_S - STEP_S, -1.0) == ""
    assert contradiction_after(OPPOSED_S + 2 * STEP_S, -1.0).startswith("heading error, yaw rate")


def test_a_steady_residual_is_found_from_its_floor_and_its_share_on() -> None:
    """At rest it is the difference x over all that moved, which is the sum of both rates."""
    bound = BOUNDS["heading"]
    floor, share = bound.floor, bound.share
    kept = math.exp(-STEP_S)
    memory_s = STEP_S * kept / (1.0 - kept)
    rate_rad_s = SPEED_M_S * 0.1
    # |1 - f| rate m = floor + share (1 + f) rate m
    factor = (1.0 + share + floor / (rate_rad_s * memory_s)) / (1.0 - share)
    assert contradiction_after(60.0, 0.99 * factor) == ""
    assert contradiction_after(60.0, 1.01 * factor) != ""


VEHICLE = nominal_vehicle(controller_preset("practical_predictor"))
assert VEHICLE is not None
LENGTH_M = VEHICLE.front_axle_distance_m + VEHICLE.rear_axle_distance_m
TURN_1_M = 0.05


def turning(state: VehicleState) -> Reported:
    """Return what is reported of a steady turn to the left, with this VEHICLE_STATE."""
    assert VEHICLE is not None
    m, _, _, c_r, l_f, l_r, l_s, _ = VEHICLE
    side_m = l_s + l_r - m * l_f * SPEED_M_S**2 / (c_r * LENGTH_M)
    steer_rad = (LENGTH_M + understeer_gradient_s2_m(VEHICLE) * SPEED_M_S**2) * TURN_1_M
    return state, -side_m * TURN_1_M, steer_rad, steer_rad


@given(
    speed_m_s=st.floats(0.0, 81.9),
    yaw_rate_rad_s=st.floats(-2.0, 2.0),
    curvature_1_m=st.floats(-0.2, 0.2),
    others=st.integers(0, 4),
)
def test_one_forged_vehicle_state_is_forgotten(
    speed_m_s: float, yaw_rate_rad_s: float, curvature_1_m: float, others: int
) -> None:
    watch = Plausibility(VEHICLE, has_plans=False)
    true = turning(motion_of(SPEED_M_S, SPEED_M_S * TURN_1_M, TURN_1_M))
    forged = turning(motion_of(speed_m_s, yaw_rate_rad_s, curvature_1_m))
    for step in range(80):
        reported = [forged] + [true] * others if step == 40 else [true]
        watch.step(mean_motion(reported, STEP_S), 0.0, true[1], true[3])
    assert watch.contradiction == ""


# With faults whose frames are valid


def run(preset: str, faults: list[dict[str, Any]], seed: int = 1, **more: Any) -> Run:
    onset = [{"onset_s": ONSET_S, "direction": "uplink", **fault} for fault in faults]
    plant = "highway_nominal" if preset.startswith("highway") else "paper_nominal"
    overrides = NOISE | {"plant.faults": onset} | more
    return simulate(plant, preset, seed=seed, duration_s=12.0, overrides=overrides)


def fault(kind: str, message: str, signal: str, magnitude: float = 1.0) -> dict[str, Any]:
    return {"kind": kind, "message": message, "signal": signal, "magnitude": magnitude}


CURVATURE = ("VEHICLE_STATE", "preview_curvature_1_m")
STEER_TWICE = {**fault("scale", "STEERING_COMMAND", "steer_rad", 2.0), "direction": "downlink"}
FOUND = {
    "curvature of the wrong sign": (fault("scale", *CURVATURE, -1.0), "heading error, yaw rate"),
    "speed ten times too high": (fault("scale", "VEHICLE_STATE", "speed_m_s", 10.0), ""),
    "error of the wrong sign": (
        fault("scale", "LATERAL_ERROR", "lateral_error_m", -1.0),
        "lateral error, heading error",
    ),
    "heading error 0.1 rad off": (fault("offset", "LATERAL_ERROR", "heading_error_rad", 0.1), ""),
    "steer doubled": (STEER_TWICE, "the wheel angle is not that of the command"),
    "wheel angle doubled": (
        fault("scale", "STEERING_STATUS", "wheel_angle_rad", 2.0),
        "the wheel angle is not that of the command",
    ),
    "yaw rate of the wrong sign": (fault("scale", "VEHICLE_STATE", "yaw_rate_rad_s", -1.0), ""),
}


STOPS = {"controller.supervision.stops_if_implausible": True}


@pytest.mark.parametrize("name", FOUND)
def test_a_wrong_signal_in_valid_frames_ends_in_safe_stop_and_is_reported(name: str) -> None:
    wrong, reason = FOUND[name]
    report = run("practical_pd_ddob", [wrong], **STOPS).controller_report
    assert report["failure"] == report["contradiction"] != ""
    assert report["failure"].startswith(reason)
    assert report["verdict"] == "fault"
    assert report["mode_s"]["safe_stop"] > 0.0
    assert not report["rejected"]


@pytest.mark.parametrize("name", ["steer doubled", "heading error 0.1 rad off"])
def test_by_default_a_contradiction_without_a_wrong_sign_is_said(name: str) -> None:
    report = run("practical_pd_ddob", [FOUND[name][0]]).controller_report
    warnings = [text for heading, text in controller_summary(report) if heading == "warning"]
    assert warnings == [f"signals of the plant: {report['contradiction']}"]
    assert report["contradiction"].startswith(FOUND[name][1])
    assert report["failure"] == ""
    assert report["verdict"] == "in control"


@pytest.mark.parametrize("message", ["LATERAL_ERROR", "STEERING_STATUS", "VEHICLE_STATE"])
def test_signals_are_not_judged_while_a_message_is_missing(message: str) -> None:
    lost = {"kind": "drop", "message": message, "duration_s": 1.5}
    path = {"kind": "single_lane_change", "start_m": 4.0, "offset_m": 1.0, "length_m": 6.0}
    report = run("practical_pd_ddob", [lost], **STOPS, **{"plant.path": path}).controller_report
    assert report["stale"][message.lower()] == 1
    assert report["contradiction"] == ""
    assert report["verdict"] == "in control"


@pytest.mark.parametrize(("factor", "is_found"), [(2.0, True), (1.2, False)])
def test_a_curvature_that_is_too_large_is_found_at_twice_and_not_at_a_fifth_more(
    factor: float, is_found: bool
) -> None:
    wrong = fault("scale", *CURVATURE, factor)
    report = run("practical_pd_ddob", [wrong]).controller_report
    assert (report["contradiction"] != "") == is_found


# Without any


def rear_steered(p: Any, x: VehicleMotion, u: Any, _own: Any) -> VehicleMotion:
    """Return the rates of a vehicle whose rear wheels turn, by the angle of ours, to the right."""
    v, l_f, l_r = p.speed_m_s, p.front_axle_distance_m, p.rear_axle_distance_m
    front = -p.front_cornering_stiffness_n_rad * (x.side_slip_rad + l_f * x.yaw_rate_rad_s / v)
    slip_rad = -u.wheel_rad - x.side_slip_rad + l_r * x.yaw_rate_rad_s / v
    rear = p.rear_cornering_stiffness_n_rad * slip_rad
    return VehicleMotion(
        (front + rear) / (p.virtual_mass_kg * v) - x.yaw_rate_rad_s,
        (l_f * front - l_r * rear) / p.yaw_inertia_kg_m2,
        x.yaw_rate_rad_s - v * u.curvature_1_m,
        v * x.side_slip_rad + p.preview_distance_m * x.yaw_rate_rad_s + v * x.heading_error_rad,
    )


REAR_STEERED = VehicleModel(rear_steered)


@pytest.mark.parametrize("seed", range(2))
def test_a_drawn_vehicle_that_steers_at_the_rear_raises_no_alarm(seed: int) -> None:
    rng = np.random.default_rng([58, seed])
    of = {
        "speed_m_s": rng.uniform(1.0, 4.0),
        "virtual_mass_kg": rng.uniform(2000.0, 6000.0),
        "yaw_inertia_kg_m2": rng.uniform(3000.0, 7000.0),
        "front_cornering_stiffness_n_rad": rng.uniform(1e5, 3e5),
        "rear_cornering_stiffness_n_rad": rng.uniform(1e5, 3e5),
        "front_axle_distance_m": rng.uniform(0.5, 1.2),
        "rear_axle_distance_m": rng.uniform(0.6, 1.2),
        "preview_distance_m": rng.uniform(1.0, 2.5),
    }
    own = {"controller.nominal_model": {"kind": "vehicle", **of}}
    vehicle = {f"plant.vehicle.{key}": value for key, value in of.items()}
    done = run("practical_pd", [], seed, **own, **vehicle, **{"plant.vehicle.model": REAR_STEERED})
    assert done.plant_report["verdict"] == "holds"
    assert done.controller_report["contradiction"] == ""


AT_SPEED = {"plant.vehicle.speed_m_s": 60.0 / 3.6}


@pytest.mark.parametrize("preset", ["highway_pd", "highway_pd_ddob", "highway_stiff_predictor"])
def test_commands_of_the_wrong_sign_are_found_though_the_wheel_is_limited(preset: str) -> None:
    wrong = {**fault("scale", "STEERING_COMMAND", "steer_rad", -1.0), "direction": "downlink"}
    done = run(preset, [wrong], **AT_SPEED)
    assert done.controller_report["failure"].startswith("the wheel turns to the other side")
    assert done.peak_m < FARTHEST_M


@pytest.mark.parametrize("lag_s", [0.0, 0.3])
def test_a_wheel_that_swings_between_its_limits_is_not_on_the_other_side(lag_s: float) -> None:
    late = {"plant.latency.downlink.mean_s": 0.45, "plant.actuator.lag_s": lag_s}
    report = run("highway_pd", [], **AT_SPEED, **late).controller_report
    assert "other side" not in report["contradiction"]
    assert report["failure"] == ""


def ordinary(seed: int) -> tuple[str, str, dict[str, Any]]:
    """Draw a preset, a vehicle of its box, network, noise, side wind and an offset."""
    rng = np.random.default_rng([40, 8, seed])
    presets = ("practical_pd", "practical_pid", "practical_pd_ddob", "practical_predictor")
    fast = ("highway_pd", "highway_pd_ddob", "highway_stiff_predictor", "highway_stiff_packet")
    is_fast = rng.random() < 0.5
    preset = str(rng.choice(fast if is_fast else presets))
    box = controller_preset(preset).validity
    assert box is not None
    assert box.speed_m_s is not None
    assert box.virtual_mass_kg is not None
    downlink_s = rng.uniform(0.0, 5e-4 * box.delay_ms_max)
    uplink_s = rng.uniform(0.0, 3e-4 * box.delay_ms_max)
    begin_s = rng.uniform(2.0, 8.0)
    wind = {
        "at_s": begin_s,
        "side_force_n": rng.uniform(-1000.0, 1000.0),
        "steering_offset_rad": rng.uniform(-0.01, 0.01),
    }
    overrides = {
        "plant.vehicle.speed_m_s": rng.uniform(*box.speed_m_s),
        "plant.vehicle.virtual_mass_kg": rng.uniform(*box.virtual_mass_kg),
        "plant.actuator.lag_s": rng.uniform(0.0, 0.1),
        "plant.sensor_noise.lateral_error_m": rng.uniform(0.0, 0.03),
        "plant.sensor_noise.heading_error_rad": rng.uniform(0.0, 0.005),
        "plant.sensor_noise.yaw_rate_rad_s": rng.uniform(0.0, 0.01),
        "plant.disturbance.steps": [
            wind,
            {"at_s": begin_s + rng.uniform(1.0, 5.0), "side_force_n": 0.0},
        ],
    }
    for line, mean_s in (("downlink", downlink_s), ("uplink", uplink_s)):
        overrides |= {
            f"plant.latency.{line}.model": "gamma",
            f"plant.latency.{line}.mean_s": mean_s,
            f"plant.latency.{line}.spread_s": mean_s * rng.uniform(0.05, 0.4),
            f"plant.latency.{line}.loss": rng.uniform(0.0, 0.05),
        }
    return "highway_nominal" if is_fast else "paper_nominal", preset, overrides


@pytest.mark.parametrize("seed", range(4))
def test_ordinary_runs_raise_no_alarm_and_never_stop(seed: int) -> None:
    plant, preset, overrides = ordinary(seed)
    done = simulate(plant, preset, seed=seed, duration_s=15.0, overrides=overrides | STOPS)
    report = done.controller_report
    assert report["contradiction"] == ""
    assert report["model"]["fits"]
    assert "model_misfit" not in report["validity_share"]


@pytest.mark.parametrize("seed", range(6))
def test_an_error_of_the_wrong_sign_stops_an_ordinary_run_near_its_path(seed: int) -> None:
    plant, preset, overrides = ordinary(seed)
    wrong = fault("scale", "LATERAL_ERROR", "lateral_error_m", -1.0)
    overrides["plant.faults"] = [{**wrong, "direction": "uplink", "onset_s": ONSET_S}]
    done = simulate(plant, preset, seed=seed, duration_s=30.0, overrides=overrides)
    assert done.controller_report["failure"].startswith("lateral error, heading error")
    assert done.peak_m < FARTHEST_M
