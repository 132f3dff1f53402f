"""Stable round trips of force feedback: closed form, crossings, eigenvalues, simulated wheels."""

from math import inf
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from steer_by_wire import SettingsError, feedback_stability, sweep
from steer_by_wire.closed_loop.pair.with_hand_wheel import with_hand_wheel
from steer_by_wire.closed_loop.scripting.feedback import (
    SampledFeedback,
    feedback_loop,
    is_unstable_at,
    sampled_feedback,
    tolerated_jitter_s,
    unstable_round_trips,
)
from steer_by_wire.closed_loop.scripting.simulate import settings_of
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.hand_wheel.analysis.nominal_road import Rack, RoadVehicle, road_torque
from steer_by_wire.hand_wheel.analysis.sampled_laws import PASS_THROUGH, sampled_cdob
from steer_by_wire.hand_wheel.settings import HandWheelSettings
from steer_by_wire.hand_wheel.wheel import GRIPS, WheelSettings, held_wheel
from steer_by_wire.plant_emulator.settings import plant_preset

UP_TO_S = 1.6


def sedan(speed_km_h: float) -> RoadVehicle:
    return RoadVehicle(speed_km_h / 3.6, 1750.0, 2900.0, 110e3, 150e3, 1.25, 1.55)


def loop_of(
    gradient_n_m: float, speed_km_h: float, grip: str, *, cycle_s: float = 1e-3,
    damping_n_m_s: float = 0.15, rack_hz: float = 8.0, has_cdob: bool = False,
) -> SampledFeedback:  # fmt: skip
    road = road_torque(sedan(speed_km_h), gradient_n_m, Rack(rack_hz))
    wheel = held_wheel(WheelSettings(damping_n_m_s=damping_n_m_s), GRIPS[grip])
    law = sampled_cdob(road, cycle_s) if has_cdob else PASS_THROUGH
    return sampled_feedback(wheel, road, cycle_s, law)


def first_unstable_ms(loop: SampledFeedback) -> float:
    ranges = unstable_round_trips(loop, UP_TO_S)
    return 1e3 * ranges[0].start_s if ranges else inf


@pytest.mark.parametrize(
    ("damping", "stiffness", "stable_ms", "passive_ms"),
    [
        (0.2, 2.0, 108, 100), (0.2, 5.0, 41.3, 40), (0.2, 10.0, 20.3, 20), (0.2, 20.0, 10.1, 10),
        (1.0, 2.0, 748, 500), (1.0, 5.0, 281, 200), (1.0, 10.0, 129.5, 100),
        (1.0, 20.0, 59.1, 50),
    ],
)  # fmt: skip
def test_a_wheel_alone_bears_what_another_program_computed(
    damping: float, stiffness: float, stable_ms: float, passive_ms: float
) -> None:
    found = feedback_stability(inertia_kg_m2=0.04, damping_n_m_s=damping, stiffness_n_m=stiffness)
    assert 1e3 * found.stable_delay_s == pytest.approx(stable_ms, abs=0.5)
    assert 1e3 * found.passive_delay_s == pytest.approx(passive_ms, rel=1e-12)


@pytest.mark.parametrize("value", [0.0, -1.0, inf, float("nan"), "x", None, [1.0], 1e308])
def test_an_impossible_wheel_is_refused(value: Any) -> None:
    with pytest.raises(SettingsError, match=r"inertia_kg_m2 = .*allowed: number from 1e-06, up"):
        feedback_stability(inertia_kg_m2=value, damping_n_m_s=0.2, stiffness_n_m=2.0)


@pytest.mark.parametrize(
    ("gradient", "grip", "expected_ms"),
    [
        (3.0, "hands_off", (302, 26, 0)), (3.0, "loose", (inf, 124, 28)),
        (6.0, "hands_off", (112, 14, 0)), (6.0, "loose", (223, 56, 15)),
        (6.0, "light", (inf, 456, 162)), (12.0, "hands_off", (30, 0, 0)),
        (12.0, "loose", (67, 16, 8)), (12.0, "light", (inf, 83, 76)),
        (12.0, "firm", (inf, inf, inf)),
    ],
)  # fmt: skip
def test_a_sedan_bears_what_another_program_computed(
    gradient: float, grip: str, expected_ms: tuple[float, ...]
) -> None:
    found = [first_unstable_ms(loop_of(gradient, speed, grip)) for speed in (30, 80, 130)]
    assert found == pytest.approx(expected_ms, abs=1.2)


@pytest.mark.parametrize("damping", [0.0, 0.2])
def test_a_car_shakes_from_the_round_trip_that_its_tyres_let_it_bear(damping: float) -> None:
    values: dict[str, Any] = {"feedback.damping_n_m_s": damping, "cycle_ms": 1.0}
    values["wheel.friction_n_m"] = 0.0
    values["driver.kicks"] = [{"at_s": 1.0, "lasts_s": 0.1, "torque_n_m": 1.0}]
    plant = plant_preset("large_sedan", ["vehicle.speed_m_s=22.2", "path.kind=straight"])
    wheel = settings_of(HandWheelSettings, "hands_off", values)
    fitting = with_hand_wheel(plant, controller_preset("highway_pd"), wheel)
    loop = feedback_loop(fitting.plant, fitting.hand_wheel)
    assert loop is not None
    first_ms = first_unstable_ms(loop)
    # Tyres that follow at once would bear more.
    at_once = feedback_loop(fitting.plant.model_copy(update={"car": None}), fitting.hand_wheel)
    assert at_once is not None
    assert first_unstable_ms(at_once) > 1.25 * first_ms
    round_trips_s = [1e-3 * round(factor * first_ms) for factor in (0.85, 1.15)]
    table = sweep(
        {"plant.latency.uplink.mean_s": round_trips_s},
        plant=fitting.plant.model_copy(update={"duration_s": 25.0}),
        controller="highway_pd",
        hand_wheel=fitting.hand_wheel,
        overrides={"controller.hand_wheel.steered_by": "driver"},
    )
    assert table["hand_wheel_verdict"].tolist() == ["still", "shakes"]


def test_damping_rack_cycle_and_cdob_move_the_round_trip_as_computed_elsewhere() -> None:
    damped = [
        first_unstable_ms(loop_of(6.0, 80, "hands_off", damping_n_m_s=0.15 + more))
        for more in (0.2, 0.5, 1.0)
    ]
    assert damped == pytest.approx([67, 142, 264], abs=1.0)
    racks = [first_unstable_ms(loop_of(6.0, 80, "loose", rack_hz=hz)) for hz in (4.0, 8.0, 16.0)]
    assert racks == pytest.approx([25, 56, 71], abs=1.0)
    slow = first_unstable_ms(loop_of(6.0, 80, "loose", cycle_s=0.01))
    assert first_unstable_ms(loop_of(6.0, 80, "loose")) - slow == pytest.approx(9.0, abs=1.0)
    observed = [
        first_unstable_ms(loop_of(6.0, speed, grip, has_cdob=True))
        for speed, grip in ((80, "hands_off"), (80, "loose"), (130, "loose"))
    ]
    assert observed == pytest.approx([810, 1100, 980], abs=3.0)


def is_stable(loop: SampledFeedback, cycles: int) -> bool:
    """Return whether all eigenvalues of loop and bus are inside the circle."""
    order = len(loop.g)
    whole = np.zeros((order + cycles, order + cycles))
    whole[:order, :order] = loop.f
    if cycles:
        whole[:order, -1], whole[order, :order] = loop.g, loop.h
        whole[order + 1 :, order:-1] = np.eye(cycles - 1)
    else:
        whole += np.outer(loop.g, loop.h)
    return bool(np.abs(np.linalg.eigvals(whole)).max() < 1.0)


@settings(max_examples=25)
@given(
    st.floats(2.0, 15.0), st.floats(20.0, 140.0), st.sampled_from(sorted(GRIPS)),
    st.sampled_from([0.005, 0.01, 0.02]), st.booleans(),
)  # fmt: skip
def test_every_range_of_round_trips_agrees_with_eigenvalues(
    gradient: float, speed_km_h: float, grip: str, cycle_s: float, has_cdob: bool
) -> None:
    loop = loop_of(gradient, speed_km_h, grip, cycle_s=cycle_s, has_cdob=has_cdob)
    ranges = unstable_round_trips(loop, 1.0)
    # On a boundary itself neither is wrong.
    near = {t for low, high, _ in ranges for t in (low, high) if t}
    for cycles in range(0, 60, 4):
        round_trip_s = cycles * cycle_s
        if not any(abs(round_trip_s - t) < 0.02 * t for t in near):
            assert is_stable(loop, cycles) != is_unstable_at(ranges, round_trip_s)


@settings(max_examples=15)
@given(
    st.floats(3.0, 12.0), st.floats(30.0, 130.0), st.sampled_from(sorted(GRIPS)),
    st.integers(0, 8), st.booleans(), st.integers(0, 999),
)  # fmt: skip
def test_a_wheel_settles_whatever_the_pattern_of_tolerated_jitter(
    gradient: float, speed_km_h: float, grip: str, cycles: int, has_cdob: bool, seed: int
) -> None:
    loop = loop_of(gradient, speed_km_h, grip, cycle_s=0.01, has_cdob=has_cdob)
    most = int(tolerated_jitter_s(loop, cycles * 0.01) / 0.01)
    ranges = unstable_round_trips(loop, 2.0)
    if most == 0:
        return
    # A longer round trip that never changes is a pattern too.
    assert ranges == () or (cycles + most) * 0.01 <= ranges[0].start_s
    rng = np.random.default_rng(seed)
    ages = rng.choice([rng.integers(0, most + 1, 6000), np.arange(6000) % (most + 1)])
    angles = np.zeros(6000)
    state = np.zeros(len(loop.g))
    state[0], past = 1.0, np.zeros(6000)
    for k in range(6000):
        angles[k], past[k] = state[0], loop.h @ state
        late = k - cycles - int(ages[k])
        state = loop.f @ state + (loop.g * past[late] if late >= 0 else 0.0)
    assert np.abs(angles[-500:]).max() < 0.7 * np.abs(angles[:1500]).max()


def test_an_unstable_loop_tolerates_no_jitter() -> None:
    loop = loop_of(6.0, 80, "hands_off")
    assert tolerated_jitter_s(loop, 0.02) == 0.0
    assert 0.008 < tolerated_jitter_s(loop, 0.004) <= 0.0101
