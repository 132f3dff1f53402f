"""Law mpc: its limits, the two ways in which it knows the path, and what is said of it."""

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from steer_by_wire import SettingsError, simulate
from steer_by_wire.controller.analysis.check_figures import loop_around
from steer_by_wire.controller.analysis.loop_signals import LoopModel
from steer_by_wire.controller.analysis.periodic_loop import PeriodicLoop
from steer_by_wire.controller.law_interface import LawInput, LoopDelay, VehicleReading
from steer_by_wire.controller.laws.law_from_settings import design_law, vehicle_of
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.plant_emulator.settings import plant_preset
from tests.support.loops.predictor_law import history

MS = 1_000_000
SPEED_M_S = 22.222
ROAD = {
    "plant.vehicle.speed_m_s": SPEED_M_S,
    "plant.vehicle.virtual_mass_kg": 1750.0,
    "plant.vehicle.yaw_inertia_kg_m2": 2900.0,
    "plant.vehicle.front_cornering_stiffness_n_rad": 120e3,
    "plant.vehicle.rear_cornering_stiffness_n_rad": 150e3,
    "plant.vehicle.front_axle_distance_m": 1.25,
    "plant.vehicle.rear_axle_distance_m": 1.5,
    "plant.actuator.lag_s": 0.115,
    "plant.path": {
        "kind": "single_lane_change", "start_m": 44.4, "offset_m": 3.5, "length_m": 53.0
    },
    "plant.latency.downlink.mean_s": 0.2,
    "plant.safety.lateral_acceleration_m_s2_max": "off",
    "plant.safety.lateral_jerk_m_s3_max": "off",
}  # fmt: skip
RATE_RAD_S = 0.05
STEP_RAD = RATE_RAD_S / 100.0


@settings(max_examples=20)
@given(
    errors_m=st.lists(st.floats(-5.0, 5.0), min_size=3, max_size=3),
    heading_rad=st.floats(-0.5, 0.5),
    curvature_1_m=st.floats(-0.1, 0.1),
    angle_rad_max=st.sampled_from((0.003, 0.02)),
)
def test_no_command_passes_the_limits_of_angle_and_rate(
    errors_m: list[float], heading_rad: float, curvature_1_m: float, angle_rad_max: float
) -> None:
    limits = (f"mpc.steer_rad_max={angle_rad_max}", f"mpc.steer_rate_rad_s_max={RATE_RAD_S}")
    law = design_law(controller_preset("highway_mpc", [*limits, "followed_point=preview"]))
    assert law.params_at is not None
    params: Any = law.params_at(SPEED_M_S)
    params = params._replace(predictor=params.predictor._replace(settling_samples=0))
    bus = history(lambda _: -1)._replace(heading_error_rad=[heading_rad] * 64)
    state: Any = law.initial_state(0.0)
    sent_rad = 0.0
    for tick, error_m in enumerate(errors_m, start=1):
        bus.lateral_error_m[tick] = error_m
        bus.sent_rad[tick - 1] = sent_rad
        vehicle = VehicleReading(SPEED_M_S, 0.0, curvature_1_m)
        observed = LawInput(error_m, sent_rad, vehicle, LoopDelay(tick, tick, tick, 0.0, True), bus)
        state, output = law.step(params, state, observed)
        assert state.predictor.is_predicting
        if tick > 1:  # the first command fades in from that of the law before
            assert abs(output.steer_rad - state.predictor.fade_rad) <= angle_rad_max + 1e-15
            step_rad = abs(output.steer_rad - state.predictor.fade_rad - sent_rad)
            assert step_rad <= STEP_RAD + 1e-15
        sent_rad = output.steer_rad - state.predictor.fade_rad


def test_a_curvature_that_is_lost_stays_in_the_estimate() -> None:
    law = design_law(controller_preset("highway_mpc", ["followed_point=preview"]))
    bent = VehicleReading(SPEED_M_S, 0.0, 0.05)
    seen = LawInput(0.1, 0.0, bent, LoopDelay(2, 2, 2, 0.0, True), history(lambda _: -1))
    lost = seen._replace(vehicle=bent._replace(is_stale=True))
    state: Any = law.step(law.params, law.initial_state(0.0), seen)[0]
    knows, loses = (law.step(law.params, state, one)[0].predictor for one in (seen, lost))
    assert loses.estimate == knows.estimate


@pytest.mark.parametrize("law", ["predictor", "packet"])
def test_a_predictor_that_reads_the_curvature_holds_a_bend_better(law: str) -> None:
    """Without PATH_AHEAD; with it, the curvature beside the preview point changes nothing."""
    reads = {"controller.predictor.curvature_averaging_s": 0.05, "controller.packet": {}}
    plans, known = {"controller.packet": {}}, {"plant.path_ahead": {}}
    ignores, follows, knows, knows_both = (
        simulate(
            *("highway_nominal", "highway_unknown_path_predictor"),
            law=law, duration_s=6, engine="compiled", overrides={**ROAD, **each},
        )
        for each in (plans, reads, plans | known, reads | known)
    )  # fmt: skip
    assert 0.005 < follows.peak_m < 0.75 * ignores.peak_m
    assert knows.peak_m == knows_both.peak_m


def test_a_plan_that_knows_the_rate_limit_turns_in_time() -> None:
    """Of a steering of 0.06 rad/s, which takes a gentler feedback."""
    slow = {
        **ROAD,
        "plant.path_ahead": {},
        "plant.actuator.rate_limit_rad_s": 0.06,
        "controller.predictor.steer_per_error_rad_m": 0.07,
    }
    knows, ignores = (
        simulate(
            *("highway_nominal", "highway_mpc"),
            duration_s=6, overrides={**slow, "controller.mpc.steer_rate_rad_s_max": rate_rad_s},
        )
        for rate_rad_s in (0.06, 0.6)
    )  # fmt: skip
    assert knows.peak_m < 0.6
    assert ignores.peak_m > 1.4 * knows.peak_m


@pytest.mark.parametrize(("wheel_lag_s", "is_stable"), [(0.13, True), (0.02, True), (0.6, False)])
def test_a_check_counts_on_the_wheel_that_the_law_reads(
    wheel_lag_s: float, is_stable: bool
) -> None:
    """At 100 km/h and 200 ms, where the steering is faster or slower than believed."""
    believing = controller_preset("highway_mpc")
    fast = vehicle_of(believing).vehicle._replace(speed_m_s=27.8, virtual_mass_kg=1400.0)
    around = PeriodicLoop(design_law(believing), believing.loop_delay, LoopModel(fast, wheel_lag_s))
    assert around.is_stable(200 * MS) is is_stable
    checked = loop_around(believing, fast, {})
    assert isinstance(checked, PeriodicLoop)
    assert checked.loop_model.actuator_lag_s == 0.13


@pytest.mark.parametrize(
    ("plant", "off_m"),
    [("large_sedan", 0.05), ("highway_nominal", 0.1), ("bmw_320i", 0.1), ("truck", 0.2)],
)
def test_another_car_is_held_within_the_default_limits(plant: str, off_m: float) -> None:
    """At 200 ms, with noise: steering lags of 0, 9, 50 and 100 ms where 130 ms are believed."""
    noise = {"lateral_error_m": 0.02, "heading_error_rad": 0.002, "yaw_rate_rad_s": 0.003}
    run = simulate(
        *(plant, "highway_mpc"),
        latency_s=0.2, duration_s=30, engine="compiled", overrides={"plant.sensor_noise": noise},
    )  # fmt: skip
    assert run.peak_m < off_m


def test_a_bus_is_held_by_a_controller_that_knows_it() -> None:
    """At 200 ms, within the default limits; taken for a sedan it leaves its road."""
    bus = plant_preset("city_bus").vehicle.model_dump()
    names = {key for key in ROAD if key.startswith("plant.vehicle.")} - {"plant.vehicle.speed_m_s"}
    model = {
        name.replace("plant.vehicle", "controller.nominal_model"): bus[name[14:]] for name in names
    }
    run = simulate(
        *("city_bus", "highway_mpc"),
        latency_s=0.2, duration_s=30, engine="compiled", overrides=model,
    )  # fmt: skip
    assert run.peak_m < 0.05


def test_a_dead_time_that_is_known_is_bridged() -> None:
    """Of 0.24 s with a lag of 0.27 s, as published of a simulator: unknown, the car is lost."""
    known = {"actuator_dead_time_s": 0.24, "actuator_lag_s": 0.27}
    run, lost = (
        simulate(
            *("large_sedan", "highway_mpc"),
            latency_s=0.1, duration_s=30, engine="compiled",
            overrides={
                "plant.actuator.published": "autoware",
                **{f"controller.estimator.{key}": value for key, value in believed.items()},
            },
        )
        for believed in (known, {})
    )  # fmt: skip
    assert run.peak_m < 0.15
    assert lost.peak_m > 3.0


def test_a_check_takes_a_dead_time_that_is_known_for_latency() -> None:
    loops = []
    for dead_time_s in (0.0, 0.08):
        dead = controller_preset("highway_mpc", [f"estimator.actuator_dead_time_s={dead_time_s}"])
        model = LoopModel(vehicle_of(dead).vehicle, 0.115)
        loops.append(PeriodicLoop(design_law(dead), dead.loop_delay, model))
    latent, with_dead_time = loops
    for latency_ms in (4, 33, 65):
        without_s = latent.decay_1_s((latency_ms + 80) * MS)
        assert with_dead_time.decay_1_s(latency_ms * MS) == pytest.approx(without_s, rel=1e-6)


def test_a_model_that_changes_is_refused_in_one_line() -> None:
    with pytest.raises(SettingsError, match=r"predictor.measures_mass must be false"):
        design_law(controller_preset("highway_mpc", ["predictor.measures_mass=true"]))
