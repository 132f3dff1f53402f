"""The verdict on one run: by the plant itself, in the studies' words and figures."""

import math
import re
from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter

from steer_by_wire import Run, simulate
from steer_by_wire.closed_loop.compiled.engine import run_compiled
from steer_by_wire.closed_loop.studies.compiled_figures import (
    Figures,
    figures_of,
    latency_figures,
    verdicts,
)
from steer_by_wire.dbc.messages import LateralError, limits
from steer_by_wire.plant_emulator.evaluation.held_figures import HeldRules
from steer_by_wire.plant_emulator.evaluation.report_in_words import verdict_text
from steer_by_wire.plant_emulator.evaluation.run_record import RunningFigures
from steer_by_wire.plant_emulator.evaluation.run_verdict import (
    JudgedRun,
    Peaks,
    RunEnd,
    Verdict,
    VerdictRules,
    judge,
    samples_judged,
)
from steer_by_wire.plant_emulator.path.corridor import Outside
from steer_by_wire.plant_emulator.settings import PlantSettings
from tests.support.suite.combinations import combined, sampled

RANGE_M = limits(LateralError)["lateral_error_m"].maximum
TIME_S = np.arange(6001) * 0.01


def judged(
    error_m: Any,
    rules: VerdictRules | None = None,
    wheel_rad: Any | None = None,
    noise_m: float = 0.0,
) -> JudgedRun:
    errors = np.asarray(error_m, dtype=np.float64)
    wheels = np.zeros(len(errors)) if wheel_rad is None else wheel_rad
    moved = errors.tolist(), wheels.tolist()
    end = RunEnd.COMPLETE if len(errors) else RunEnd.NO_START
    if np.any(np.abs(errors) > RANGE_M):
        end = RunEnd.LEFT_RANGE
    return judge(rules or VerdictRules(), *moved, end, noise_m, peaks_of(errors), 0.01, len(errors))


def peaks_of(error_m: Any) -> Peaks:
    off_m = np.abs(error_m)
    settled_m = np.max(off_m[500:]) if len(off_m) > 500 else math.nan
    return Peaks(float(np.max(off_m, initial=0.0)), float(settled_m))


CONES = Outside(0.123, 3, 47.34)


def sine(amplitude_m: float, growth_1_s: float = 0.0) -> Any:
    return amplitude_m * np.exp(growth_1_s * TIME_S) * np.sin(2.0 * TIME_S)


CASES: Mapping[Verdict, Any] = {
    Verdict.NO_START: (),
    Verdict.TOO_SHORT: sine(0.01)[:99],
    Verdict.LEFT_RANGE: TIME_S**2 * 0.05,
    Verdict.UNSTABLE: sine(1e-3, 0.1),
    Verdict.LIMIT_CYCLE: sine(0.2),
    Verdict.DRIFTS: 0.01 * TIME_S,
    Verdict.LEFT_ROAD: np.where(TIME_S < 5.0, 2.0, 0.0),
    Verdict.DECAYS: np.exp(-TIME_S / 20.0) * 5.0 * (TIME_S > 20.0),
    Verdict.OFF_PATH: np.full(6001, 0.3),
    Verdict.LEFT_PATH: 0.3 * (np.abs(TIME_S - 10.0) < 0.5),
    Verdict.HOLDS: sine(0.01),
}
SHAKEN_RAD = 0.3 * np.random.default_rng(1).standard_normal(6001)


@pytest.mark.parametrize(
    "verdict", [one for one in Verdict if one not in (Verdict.DECAYS, Verdict.LEFT_CORRIDOR)]
)
def test_each_verdict_has_its_reason_in_the_line(verdict: Verdict) -> None:
    shakes = verdict is Verdict.WHEEL_SHAKES
    error_m = CASES[Verdict.HOLDS if shakes else verdict]
    found = judged(error_m, wheel_rad=SHAKEN_RAD if shakes else None)
    assert found.verdict is verdict
    peaks_m = peaks_of(error_m)
    report = {
        **found.report(),
        "judged_point": "preview",
        "judged_peak_m": peaks_m.whole_m,
        "settled_s": 5.0,
        "settled_peak_m": peaks_m.settled_m,
        "corridor": None,
        "limited_share_by": {},
    }
    text = verdict_text(report)
    assert text.startswith(f"{verdict}: ")
    assert "nan" not in text
    assert "\n" not in text


def test_a_body_outside_its_corridor_is_told_where_and_by_how_much() -> None:
    error_m = np.full(6001, 0.1)
    moved = error_m.tolist(), (0.0 * error_m).tolist()

    def said(outside: Outside, peak_m: float = 0.1) -> str:
        peaks_m = Peaks(peak_m, peak_m, outside.outside_m)
        found = judge(VerdictRules(), *moved, RunEnd.COMPLETE, 0.0, peaks_m, 0.01, len(error_m))
        asked = {"judged_point": "preview", "judged_peak_m": peak_m, "limited_share_by": {}}
        return verdict_text({**found.report(), **asked, "corridor": outside._asdict()})

    left = "left corridor: the body left the corridor at 47.3 m (section 3) by 123.0 mm"
    assert said(CONES) == left
    # The corridor decides, not the distance from the path within it.
    within = said(CONES._replace(outside_m=-0.123), 0.4)
    assert within.startswith("holds: preview point at most 100.0 mm off in the last 15 s, ")
    assert within.endswith("within the corridor by 123.0 mm or more, least at 47.3 m (section 3)")


def test_thresholds_are_settings() -> None:
    error_m = np.full(6001, 0.3)
    assert judged(error_m).verdict is Verdict.OFF_PATH
    assert judged(error_m, VerdictRules(off_path_m=0.4)).verdict is Verdict.HOLDS
    settings = PlantSettings(duration_s=2.0, verdict=VerdictRules(off_path_m=1e-6))
    assert simulate(settings).plant_report["verdict"] in ("off path", "drifts")


def test_a_short_run_has_windows_of_a_quarter_and_one_of_a_moment_has_none() -> None:
    short = judged(0.2 * np.sin(10.0 * TIME_S)[:801])
    assert short.windows.amplitude_m == pytest.approx(0.2, rel=0.1)
    moment = judged([0.1, -0.2, 0.1])
    assert moment.verdict is Verdict.TOO_SHORT
    assert judged(sine(0.01)[:100]).verdict is Verdict.HOLDS
    assert moment.windows.end_peak_m == 0.2
    assert math.isnan(moment.windows.amplitude_m)


def test_only_the_samples_of_two_windows_are_kept() -> None:
    rules = VerdictRules(window_s=1.0)
    newest = samples_judged(rules, 60.0, 0.01)
    figures = RunningFigures(HeldRules(), newest)
    for value in sine(0.2).tolist():
        figures.add(0.0, 0.0, value, 0.0, "")
    assert len(figures.newest_m) == newest == 300
    moved = list(figures.newest_m), list(figures.newest_wheel_rad)
    kept = judge(
        rules, *moved, RunEnd.COMPLETE, 0.0, peaks_of(sine(0.2)), 0.01, figures.held.samples
    )
    assert kept == judged(sine(0.2), rules)


def studied_figures(run: Run, motion: Any, sent_rad: Any) -> Figures:
    """Return the figures by which a study judges this motion of the car."""
    plant, controller = run.plant_settings, run.controller_settings
    car_m = motion.cg_deviation_m
    moved = motion.time_s, motion.lateral_error_m, car_m, car_m, motion.wheel_angle_rad
    return figures_of(plant.verdict, plant, controller, *moved, sent_rad)


@pytest.mark.parametrize(("delay_s", "noise_m"), [(0.5, 0.0), (0.39, 0.02)])
def test_the_plant_judges_a_run_as_a_study_does(delay_s: float, noise_m: float) -> None:
    run = simulate(
        controller="practical_pd_dob",
        duration_s=40.0,
        overrides={
            "plant.latency.downlink.mean_s": delay_s,
            "plant.sensor_noise.lateral_error_m": noise_m,
        },
    )
    plant, figures = run.plant_settings, studied_figures(run, run.plant, run.controller.sent_rad)
    complete = np.array([list(RunEnd).index(RunEnd.COMPLETE)])
    (studied,) = verdicts(plant.verdict, complete, np.array([figures]))
    assert run.plant_report["verdict"] == studied == ("limit cycle" if delay_s == 0.5 else "holds")
    assert run.plant_report["settling_s"] == pytest.approx(figures.settling_s)
    assert run.plant_report["settled_rms_m"] == figures.settled_rms_m == run.settled_rms_m
    assert run.plant_report["rms_m"] == figures.rms_m == run.rms_m
    windows = dict(run.plant_report["windows"])
    assert windows.pop("window_s") == 10.0
    for name, value in windows.items():
        studied_value = getattr(figures, name)
        assert value == (None if math.isnan(studied_value) else pytest.approx(studied_value))
    assert latency_figures(run.plant.downlink_latency_s).latency_mean_s == pytest.approx(delay_s)


# Who limits


@pytest.mark.parametrize(
    ("preset", "where"),
    sampled(
        [("highway_stiff_predictor", ("d", 0.02)), ("highway_pd_ddob", ("c", 0.02))],
        combined(
            ["highway_pd", "highway_pd_ddob", "highway_stiff_predictor", "highway_stiff_packet"],
            [("d", 0.0), ("d", 0.02), ("b", 0.0), ("c", 0.02)],
        ),
    ),
)
def test_the_steering_passes_the_lane_change_for_the_highway(
    preset: str, where: tuple[str, float]
) -> None:
    corner, noise_m = where
    noise = {"plant.sensor_noise.lateral_error_m": noise_m}
    report = simulate(f"highway_corner_{corner}", preset, overrides=noise).plant_report
    assert report["verdict"] == "holds"
    assert report["limited_share"] < 0.02


def test_limits_that_forbid_the_manoeuvre_are_named() -> None:
    run = simulate(
        "highway_corner_c", "highway_stiff_predictor", overrides={"plant.path.length_m": 30.0}
    )
    report = run.plant_report
    assert report["verdict"] != "holds"
    assert report["preview_rms_m"] > 0.3
    assert 0.1 < report["limited_share"] == pytest.approx(sum(report["limited_share_by"].values()))
    assert set(report["limited_share_by"]) == {"lateral_jerk", "lateral_acceleration"}
    assert "the plant's steering limited for " in verdict_text(report)
    assert "lateral jerk" in verdict_text(report)


def test_an_actuator_that_limits_is_named() -> None:
    run = simulate(duration_s=5.0, overrides={"plant.actuator.angle_limit_rad": 0.01})
    assert set(run.plant_report["limited_share_by"]) == {"actuator"}


def test_limits_of_the_controller_are_named_by_the_controller() -> None:
    run = simulate(duration_s=5.0, overrides={"controller.limits.steer_rad_max": 0.05})
    assert run.controller_report["limited_share_by"]["angle"] > 0.5
    assert run.controller_report["limited_share"] <= 1.0
    assert simulate(duration_s=5.0).controller_report["limited_share"] == 0.0


# The wheel


def test_a_wheel_that_slams_does_not_hold_though_the_vehicle_cannot_follow() -> None:
    run = simulate(
        controller="paper_pd",
        duration_s=10.0,
        overrides={"plant.sensor_period_ms": 1, "plant.latency.downlink.mean_s": 0.014},
    )
    assert run.plant_report["windows"]["end_peak_m"] < VerdictRules().off_path_m
    text = verdict_text(run.plant_report)
    assert re.match(
        r"limit cycle: swings of ±\d\.\d mm at 15\d rad/s that last, "
        r"the wheel's of ±0\.[56]\d* rad at 15\d rad/s",
        text,
    ), text
    study = run_compiled(run.plant_settings, run.controller_settings)
    figures = studied_figures(run, study, study.sent_rad)
    complete = np.array([list(RunEnd).index(RunEnd.COMPLETE)])
    assert verdicts(VerdictRules(), complete, np.array([figures])) == [Verdict.LIMIT_CYCLE]


@pytest.mark.parametrize(
    ("wheel_rad", "verdict"),
    [
        (0.018 * np.sin(20.0 * TIME_S), Verdict.HOLDS),
        (0.022 * np.sin(20.0 * TIME_S), Verdict.LIMIT_CYCLE),
        (1e-3 * np.exp(0.06 * TIME_S) * np.sin(20.0 * TIME_S), Verdict.UNSTABLE),
        (2e-4 * np.exp(0.06 * TIME_S) * np.sin(20.0 * TIME_S), Verdict.UNSTABLE),
        (1e-4 * np.exp(0.06 * TIME_S) * np.sin(20.0 * TIME_S), Verdict.HOLDS),
        (0.3 * np.exp(-0.05 * TIME_S) * np.sin(20.0 * TIME_S), Verdict.HOLDS),
        (3.0 * np.exp(-0.04 * TIME_S) * np.sin(20.0 * TIME_S), Verdict.WHEEL_SHAKES),
        (0.4 * np.sin(0.4 * TIME_S), Verdict.HOLDS),  # a path that bends
        (0.1 * np.random.default_rng(1).standard_normal(6001), Verdict.HOLDS),
        (0.2 * np.random.default_rng(1).standard_normal(6001), Verdict.WHEEL_SHAKES),
    ],
)
def test_the_wheel_is_judged_by_its_fast_motion(wheel_rad: Any, verdict: Verdict) -> None:
    assert judged(np.zeros(6001), wheel_rad=wheel_rad).verdict is verdict


# Noise


def test_noise_in_a_resonant_loop_is_no_oscillation_of_the_wheel() -> None:
    """Of 30 mrad (RMS), for every seed of 100; by the rule without noise many of them were."""
    decay, turn, samples = math.exp(-0.02), 0.06, 2000
    denominator = [1.0, -2.0 * decay * math.cos(turn), decay**2]
    held = Counter[float]()
    for seed in range(100):
        white = np.random.default_rng(seed).normal(size=samples)
        wheel_rad = lfilter([1.0], denominator, white)
        wheel_rad *= 0.03 / np.std(wheel_rad)
        for noise_m in (0.0, 0.02):
            found = judged(np.zeros(samples), None, wheel_rad, noise_m)
            held[noise_m] += found.verdict is Verdict.HOLDS
    assert held[0.02] == 100
    assert held[0.0] < 90


@pytest.mark.parametrize(
    ("noise_m", "wheel_rad", "verdict"),
    [
        (1e-6, 0.022, Verdict.LIMIT_CYCLE),
        (0.002, 0.022, Verdict.LIMIT_CYCLE),
        (0.02, 0.11, Verdict.HOLDS),
        (0.02, 0.13, Verdict.LIMIT_CYCLE),
        (0.1, 0.18, Verdict.HOLDS),
        (0.1, 0.25, Verdict.WHEEL_SHAKES),
    ],
)
def test_the_least_oscillation_of_the_wheel_follows_the_noise(
    noise_m: float, wheel_rad: float, verdict: Verdict
) -> None:
    wave = wheel_rad * np.sin(20.0 * TIME_S)
    assert judged(np.zeros(6001), None, wave, noise_m).verdict is verdict


def test_noise_does_not_make_an_error_unstable_by_chance() -> None:
    grows = np.where(TIME_S < 45.0, 0.01, 0.02) * np.sin(2.0 * TIME_S)
    assert judged(grows).verdict is Verdict.UNSTABLE
    assert judged(grows, noise_m=0.02).verdict is Verdict.HOLDS
    assert judged(8.0 * grows, noise_m=0.02).verdict is Verdict.UNSTABLE


# The whole manoeuvre, and the point that is followed


def test_a_car_that_crossed_the_path_and_is_closer_than_before_does_not_drift() -> None:
    assert judged(np.where(TIME_S < 45.0, -0.9, 0.46)).verdict is Verdict.DECAYS
    assert judged(np.where(TIME_S < 45.0, -0.46, 0.9)).verdict is Verdict.DRIFTS


def test_an_error_within_the_first_seconds_is_that_of_the_start() -> None:
    start = np.where(TIME_S < 4.9, 1.0, 0.0)
    assert judged(start).verdict is Verdict.HOLDS
    assert judged(start, VerdictRules(settled_s=4.0)).verdict is Verdict.HOLDS
    assert judged(np.where(TIME_S < 5.1, 1.0, 0.0)).verdict is Verdict.LEFT_PATH


def test_a_lane_change_states_its_peak_and_a_wide_one_has_left_the_path() -> None:
    text = verdict_text(simulate("highway_corner_c", "highway_pd").plant_report)
    peak = re.fullmatch(r"holds: car at most .* mm off .* s, (\d+\.\d) mm in .*", text)
    assert peak, text
    assert float(peak[1]) > 100.0
    strict = {"plant.verdict.off_path_m": 1e-3 * float(peak[1]) - 0.01}
    text = verdict_text(simulate("highway_corner_c", "highway_pd", overrides=strict).plant_report)
    assert text == (f"left path: car up to {peak[1]} mm off after 5 s, though back at the end")


@pytest.mark.parametrize("point", ["centre_of_gravity", "rear_axle"])
def test_another_point_than_the_car_is_judged_where_asked(point: str) -> None:
    followed = {"controller.followed_point": point, "plant.verdict.judged_point": point}
    run = simulate(controller="practical_predictor", duration_s=20.0, overrides=followed)
    report = run.plant_report
    assert report["judged_point"] == point
    # The preview point leaves the path by a decimetre, for the other point to be on it.
    assert report["settled_peak_m"] < 0.01 < 0.05 < np.max(np.abs(run.plant.lateral_error_m[500:]))
    name = {"centre_of_gravity": "car", "rear_axle": "rear axle"}[point]
    assert verdict_text(report).startswith(f"holds: {name} at most ")
    if point == "centre_of_gravity":
        assert report["judged_peak_m"] == report["peak_m"]
    plant, controller = run.plant_settings, run.controller_settings
    study = run_compiled(plant, controller)
    behind_m = plant.verdict.behind_preview_m(plant.vehicle)
    assert np.max(np.abs(study.deviation_m(behind_m)[500:])) == report["settled_peak_m"]


def test_a_run_is_judged_by_the_car_whatever_its_law_follows() -> None:
    circle = {"plant.path": {"kind": "circle", "radius_m": 8.0}}
    follows = {"controller.followed_point": "preview"}
    run = simulate(controller="practical_pid", duration_s=30.0, overrides=circle | follows)
    node = run.plant_report
    assert run.lateral_error_rms_m < 0.1 < node["settled_rms_m"]
    assert node["judged_peak_m"] == node["peak_m"] > 0.5
    assert node["verdict"] == "off path"
