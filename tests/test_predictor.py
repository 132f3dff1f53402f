"""The predictor's parts against independent views, and the law through network and faults."""

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from controller import predictor as predictor_module
from controller.design import design_law, design_predictor
from controller.estimator import (
    STARTS_ANEW_AFTER,
    EstimatorState,
    VehicleGains,
    command_from,
    estimator_at_rest,
    model_step,
    start_estimate,
)
from controller.law_interface import History, LawInput, Link
from controller.law_settings import EstimatorSettings, VehicleModelSettings
from controller.link import LinkParams
from controller.node import ControllerNode
from controller.predictor import predict, steer_for
from controller.predictor_design import design_schedule, sampled_vehicle
from controller.settings import ControllerSettings, age_limits_of
from dbc.messages import CAN_IDS, Mode, SteeringStatus
from plant_emulator.node import PlantNode
from plant_emulator.propagation import LinearState, propagate, table_rows, transition_table
from plant_emulator.propagation import augmented_matrix as emulator_matrix
from plant_emulator.settings import PlantSettings
from plant_emulator.vehicle import VehicleParams
from runtime.frame import Frame
from runtime.settings import load_settings, read_preset
from runtime.virtual_time import VirtualTimeExecutor

MS = 1_000_000
PERIOD_NS = 10 * MS
LINK = LinkParams(PERIOD_NS, PERIOD_NS, 50.0)
SPEEDS = (0.5, 1.39, 1.94, 8.0, 16.7)
VEHICLE = VehicleModelSettings(
    kind="vehicle",
    virtual_mass_kg=2000.0,
    yaw_inertia_kg_m2=3728.0,
    front_cornering_stiffness_n_rad=195e3,
    rear_cornering_stiffness_n_rad=500e3,
    front_axle_distance_m=1.3008,
    rear_axle_distance_m=1.5453,
    preview_distance_m=1.912,
    speed_m_s=5.0 / 3.6,
)


def gains(speed_m_s: float, lag_s: float = 0.0, sensor_period_s: float = 0.01) -> VehicleGains:
    """Return the gains at one speed, which is made the lowest of the table."""
    settings = EstimatorSettings(actuator_lag_s=lag_s, speed_m_s_min=speed_m_s, speed_m_s_max=80.0)
    return design_schedule(settings, VEHICLE, 0.01, sensor_period_s, 1.0).gains[0]


# The model


def exact_step(state: EstimatorState, speed_m_s: float, lag_s: float, u: float) -> np.ndarray:
    """Return β r Δψ y δ after 10 ms of a held command, by scipy, with (1) written out."""
    p, v = VEHICLE, speed_m_s
    m, j = p.virtual_mass_kg, p.yaw_inertia_kg_m2
    c_f, c_r = p.front_cornering_stiffness_n_rad, p.rear_cornering_stiffness_n_rad
    l_f, l_r = p.front_axle_distance_m, p.rear_axle_distance_m
    rate = np.zeros((8, 8))  # of β r Δψ y δ ρ d u
    front, rear = c_f / (m * v), c_r / (m * v)
    rate[0, [0, 1, 4, 6]] = [-front - rear, (c_r * l_r - c_f * l_f) / (m * v * v) - 1, front, front]
    turning = c_f * l_f / j
    rate[1, [0, 1, 4, 6]] = [
        (c_r * l_r - c_f * l_f) / j,
        -(c_f * l_f**2 + c_r * l_r**2) / (j * v),
        turning,
        turning,
    ]
    rate[2, [1, 5]] = [1.0, -v]
    rate[3, [0, 1, 2]] = [v, p.preview_distance_m, v]
    start = [
        *state[1:5],
        state.wheel_rad if lag_s else u,
        state.curvature_1_m,
        state.offset_rad,
        u,
    ]
    if lag_s:
        rate[4, [4, 7]] = [-1.0 / lag_s, 1.0 / lag_s]
    return np.asarray((expm(0.01 * rate) @ start)[:5])


ANY_STATE = EstimatorState(7, 0.02, -0.1, 0.05, -0.3, 0.04, 0.01, 0.06)


@pytest.mark.parametrize("speed_m_s", SPEEDS)
@pytest.mark.parametrize("lag_s", [0.0, 0.02, 0.27])
def test_a_model_step_is_the_exact_solution(speed_m_s: float, lag_s: float) -> None:
    after = model_step(gains(speed_m_s, lag_s), ANY_STATE, 0.2)
    expected = exact_step(ANY_STATE, speed_m_s, lag_s, 0.2)
    np.testing.assert_allclose([*after[1:5], after.wheel_rad], expected, rtol=1e-12, atol=1e-15)
    assert (after.sample, after.curvature_1_m, after.offset_rad) == (8, 0.04, 0.01)


@pytest.mark.parametrize("speed_m_s", SPEEDS)
def test_the_model_is_that_of_the_plant_emulator(speed_m_s: float) -> None:
    p = VEHICLE
    vehicle = VehicleParams(
        speed_m_s,
        p.virtual_mass_kg,
        p.yaw_inertia_kg_m2,
        p.front_cornering_stiffness_n_rad,
        p.rear_cornering_stiffness_n_rad,
        p.front_axle_distance_m,
        p.rear_axle_distance_m,
        p.preview_distance_m,
    )
    table = table_rows(transition_table(emulator_matrix(vehicle, 0.0)))
    g = gains(speed_m_s)
    x = ANY_STATE
    z = LinearState(*x[1:5], 0.2 + x.offset_rad, 0.0, x.curvature_1_m, 0.0, 0.0, 0.0)
    for _ in range(300):
        x = model_step(g, x, 0.2)
        z = propagate(table, 0, z, PERIOD_NS)
    np.testing.assert_allclose(x[1:5], z[:4], rtol=1e-9)


@pytest.mark.parametrize("speed_m_s", SPEEDS)
@pytest.mark.parametrize("lag_s", [0.0, 0.27])
def test_on_a_circle_the_steer_of_the_steady_state_holds_the_circle(
    speed_m_s: float, lag_s: float
) -> None:
    """From the path's own rest the law and its model go on for ever without an error."""
    g, curvature_1_m = gains(speed_m_s, lag_s), 1.0 / 12.0
    p = VEHICLE
    wheelbase_m = p.front_axle_distance_m + p.rear_axle_distance_m
    c_f, c_r = p.front_cornering_stiffness_n_rad, p.rear_cornering_stiffness_n_rad
    l_f, l_r = p.front_axle_distance_m, p.rear_axle_distance_m
    understeer = p.virtual_mass_kg * (c_r * l_r - c_f * l_f) / (c_f * c_r * wheelbase_m)
    steer_rad = curvature_1_m * (wheelbase_m + understeer * speed_m_s**2)
    side_slip_rad = curvature_1_m * (
        l_r - p.virtual_mass_kg * l_f * speed_m_s**2 / (c_r * wheelbase_m)
    )
    heading_rad = -side_slip_rad - p.preview_distance_m * curvature_1_m
    x = EstimatorState(
        0, side_slip_rad, speed_m_s * curvature_1_m, heading_rad, 0.0, curvature_1_m, 0.0, steer_rad
    )
    assert steer_for(g, x) == pytest.approx(steer_rad, rel=1e-9)
    for _ in range(500):
        x = model_step(g, x, steer_for(g, x))
    assert abs(x.lateral_error_m) < 1e-9
    assert x.heading_error_rad == pytest.approx(heading_rad, rel=1e-6)


@pytest.mark.parametrize("lag_s", [0.0, 0.27])
def test_a_steering_offset_that_is_known_leaves_no_error(lag_s: float) -> None:
    g = gains(1.39, lag_s)
    x = EstimatorState(0, 0.0, 0.0, 0.1, 0.5, 0.0, 0.03, 0.0)
    for _ in range(6000):
        x = model_step(g, x, steer_for(g, x))
    assert abs(x.lateral_error_m) < 1e-9
    assert x.wheel_rad == pytest.approx(-0.03, abs=1e-9)


def test_gains_between_two_speeds_of_the_table_are_between_theirs() -> None:
    schedule = design_schedule(EstimatorSettings(), VEHICLE, 0.01, 0.01, 1.0)
    low, high = schedule.speeds_m_s[10:12]
    middle = schedule.at(0.25 * low + 0.75 * high)
    expected = 0.25 * np.array(schedule.gains[10]) + 0.75 * np.array(schedule.gains[11])
    np.testing.assert_allclose(middle, expected)
    assert schedule.at(0.0) == schedule.gains[0]
    assert schedule.at(1e3) == schedule.gains[-1]


def test_half_way_between_two_speeds_of_the_table_no_gain_is_off_by_more_than_3_percent() -> None:
    """That much only where one crosses zero; of the larger of its two neighbours."""
    schedule = design_schedule(EstimatorSettings(), VEHICLE, 0.01, 0.01, 1.0)
    for low, high in pairwise(schedule.speeds_m_s):
        speed_m_s = 0.5 * (low + high)
        off = np.abs(np.subtract(schedule.at(speed_m_s), gains(speed_m_s)))
        larger = np.maximum(np.abs(schedule.at(low)), np.abs(schedule.at(high)))
        assert (off <= 0.03 * larger).all()


def test_the_sampled_model_over_two_periods_is_that_of_one_twice() -> None:
    settings = EstimatorSettings(actuator_lag_s=0.1)
    once = sampled_vehicle(settings, VEHICLE, 1.39, 0.01)
    twice = sampled_vehicle(settings, VEHICLE, 1.39, 0.02)
    np.testing.assert_allclose(twice.f, once.f @ once.f, atol=1e-15)
    np.testing.assert_allclose(twice.g, once.f @ once.g + once.g, atol=1e-15)


# Which command acts from a sample to the next


SENT = [0.1 * tick for tick in range(64)]


def history(
    applied: Callable[[int], int] = lambda sample: sample - 3,
    overruled: Mapping[int, float] = MappingProxyType({}),
) -> History:
    """Return what was sent, applied, and by sample where the wheel was instead."""
    return History(
        63,
        63,
        SENT,
        [0.0] * 64,
        [0.0] * 64,
        [True] * 64,
        [applied(sample) for sample in range(64)],
        [sample in overruled for sample in range(64)],
        [overruled.get(sample, math.nan) for sample in range(64)],
    )


def expected_mean(begin_ns: float, link: LinkParams, first_tick: int, last_tick: int) -> float:
    """Return the mean over a sensor period by looking every microsecond."""
    times_ns = begin_ns + (np.arange(10_000) + 0.5) * link.sensor_period_ns / 10_000
    ticks = np.clip(np.floor(times_ns / link.period_ns), first_tick, last_tick).astype(int)
    return float(np.mean([SENT[tick] if tick >= 0 else 0.0 for tick in ticks]))


def test_where_both_echoes_name_one_command_it_is_that() -> None:
    link = Link(30, 20, 20, 30.0 * MS, True)
    assert command_from(LINK, link, history(lambda _: 12), 10) == SENT[12]


def test_where_two_echoes_name_two_commands_it_is_half_of_each() -> None:
    link = Link(30, 20, 20, 30.0 * MS, True)
    assert command_from(LINK, link, history(), 10) == pytest.approx(0.5 * (SENT[7] + SENT[8]))


def test_where_the_steering_overrules_its_command_it_is_the_wheel() -> None:
    link = Link(30, 20, 20, 30.0 * MS, True)
    wheel = {10: 0.5, 11: 0.3, 12: 0.2}
    seen = history(lambda _: 12, wheel)
    assert command_from(LINK, link, seen, 9) == pytest.approx(0.5 * (SENT[12] + 0.5))
    assert command_from(LINK, link, seen, 10) == pytest.approx(0.4)
    assert command_from(LINK, link, seen, 12) == pytest.approx(0.5 * (0.2 + SENT[12]))
    assert command_from(LINK, link, seen, 13) == SENT[12]


def test_where_no_command_is_applied_there_is_no_steer() -> None:
    link = Link(30, 20, 20, 30.0 * MS, True)
    assert command_from(LINK, link, history(lambda _: -1), 10) == 0.0
    never = Link(30, -1, -1, 30.0 * MS, True)
    assert command_from(LINK, never, history(lambda _: -1), 1) == 0.0


@pytest.mark.parametrize("delay_ms", [0.0, 20.0, 30.0, 33.7, 35.0, 78.2])
@pytest.mark.parametrize(("period_ms", "sensor_period_ms"), [(10, 10), (5, 10), (10, 7), (20, 10)])
@pytest.mark.parametrize("ahead", range(6))
def test_a_command_that_no_echo_has_shown_is_expected_after_the_delay(
    delay_ms: float, period_ms: int, sensor_period_ms: int, ahead: int
) -> None:
    p = LinkParams(period_ms * MS, sensor_period_ms * MS, 50.0)
    echo_sample = 20
    earliest = int((echo_sample * sensor_period_ms - delay_ms) // period_ms)
    sample = echo_sample + ahead
    link = Link(earliest + 30, sample, echo_sample, delay_ms * MS, True)
    seen = command_from(p, link, history(lambda _: earliest), sample)
    begin_ns = sample * p.sensor_period_ns - delay_ms * MS
    assert seen == pytest.approx(expected_mean(begin_ns, p, earliest, link.tick - 1), abs=2e-4)


def test_a_command_older_than_the_newest_echoed_is_in_effect_no_more() -> None:
    """One that has overtaken: the echo is ahead of what the delay leads to expect."""
    link = Link(30, 20, 20, 80.0 * MS, True)
    assert command_from(LINK, link, history(lambda _: 18), 20) == SENT[18]


def test_a_command_that_is_not_yet_sent_is_the_last_one_sent() -> None:
    link = Link(30, 20, 20, 30.0 * MS, True)
    assert command_from(LINK, link, history(lambda _: 17), 60) == SENT[29]


# Starting, and predicting


def test_an_estimate_begins_at_the_newest_sample_with_echo_and_measurement() -> None:
    h = history()._replace(lateral_error_m=[0.5] * 64, heading_error_rad=[0.1] * 64)
    link = Link(30, 22, 20, 30.0 * MS, True)
    assert start_estimate(estimator_at_rest(9.0), link, h) == EstimatorState(
        20, 0.0, 0.0, 0.1, 0.5, 0.0, 0.0, 0.0
    )


def test_no_estimate_begins_without_echo_or_measurement() -> None:
    x = estimator_at_rest(0.5)
    assert start_estimate(x, Link(30, 22, -1, 0.0, False), history()) == x
    unseen = history()._replace(has_error=[False] * 64)
    assert start_estimate(x, Link(30, 22, 20, 0.0, True), unseen) == x


def test_an_estimate_goes_on_through_a_gap_and_begins_anew_after_a_long_one() -> None:
    x = EstimatorState(20, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7)
    near, far = 20 + STARTS_ANEW_AFTER, 21 + STARTS_ANEW_AFTER
    assert start_estimate(x, Link(400, near, near, 0.0, True), history()) == x
    anew = start_estimate(x, Link(400, far, far, 0.0, True), history())
    assert anew == EstimatorState(far, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def controller(*overrides: str) -> ControllerSettings:
    preset = read_preset("controller.presets", "practical_pd_ddob")
    settings = ("law=predictor", "predictor.horizon_s_max=1.0", *overrides)
    return load_settings(ControllerSettings, preset, None, settings)


@pytest.mark.parametrize("horizon", [0.0, 1.0, 2.5, 7.25])
def test_a_prediction_is_the_model_run_on_and_linear_between_two_samples(horizon: float) -> None:
    p = design_predictor(controller())(1.39)
    link = Link(40, 20, 20, 30.0 * MS, True)
    x = ANY_STATE._replace(sample=20)
    states = [x]
    for _ in range(9):
        last = states[-1]
        states.append(model_step(p.gains, last, command_from(LINK, link, history(), last.sample)))
    low, part = int(horizon), horizon % 1.0
    expected = (1.0 - part) * np.array(states[low]) + part * np.array(states[low + 1])
    found = predict(p, x, link, history(), horizon)
    np.testing.assert_allclose(found[1:], expected[1:], rtol=1e-12)


# The law, in virtual time


def plant(*overrides: str) -> PlantSettings:
    preset = read_preset("plant_emulator.presets", "paper_corner_d")
    return load_settings(PlantSettings, preset, None, overrides)


def run(
    plant_settings: PlantSettings,
    controller_settings: ControllerSettings,
    is_dropped: Callable[[Frame, int], bool] = lambda _frame, _now_ns: False,
) -> tuple[PlantNode, ControllerNode]:
    """Run both nodes; ``is_dropped`` says which frames never reach the controller."""

    class Deaf(ControllerNode):
        def on_frame(self, frame: Frame, now_ns: int) -> Sequence[Frame]:
            return () if is_dropped(frame, now_ns) else super().on_frame(frame, now_ns)

    plant_node = PlantNode(plant_settings, 0)
    controller_node = Deaf(controller_settings, 0, samples_max=100_000)
    executor = VirtualTimeExecutor((plant_node, controller_node), None, None)
    executor.run(round(plant_settings.duration_s * 1e9) + 1_000_000_000)
    return plant_node, controller_node


def rms_after_5_s(plant_settings: PlantSettings, controller_settings: ControllerSettings) -> float:
    plant_node, _ = run(plant_settings, controller_settings)
    errors = [s.lateral_error_m for s in plant_node.samples if s.time_s > 5.0]
    return float(np.sqrt(np.mean(np.square(errors))))


ELLIPSE = 'path={kind="ellipse", semi_major_axis_m=30, semi_minor_axis_m=15}'
SHARP = "predictor.steer_per_error_rad_m=4"
"""A feedback that needs its prediction: without one it does not survive these networks."""
VARYING = (
    *("latency.downlink.model=gamma", "latency.downlink.mean_s=0.4"),
    *("latency.downlink.spread_s=0.06", "latency.downlink.loss=0.02"),
    *("latency.uplink.model=gamma", "latency.uplink.mean_s=0.06"),
    *("latency.uplink.spread_s=0.03", "latency.uplink.loss=0.02"),
)
REORDERED = (
    *("latency.downlink.model=gamma", "latency.downlink.mean_s=0.1"),
    *("latency.downlink.spread_s=0.05", "latency.downlink.order=as_arrives"),
    *("latency.uplink.model=uniform", "latency.uplink.mean_s=0.08"),
    *("latency.uplink.spread_s=0.04", "latency.uplink.order=as_arrives"),
)


@pytest.mark.parametrize("network", [VARYING, REORDERED], ids=["lossy", "reordered"])
def test_the_path_is_held_with_latency_that_varies_in_both_directions(
    network: Sequence[str],
) -> None:
    rms_m = rms_after_5_s(plant("duration_s=20", ELLIPSE, *network), controller(SHARP))
    assert 1e-4 < rms_m < 0.003


@pytest.mark.parametrize("share", [-1.0, 0.0, 2.0])
def test_another_delay_than_that_measured_does_not_hold_it(
    share: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So the tests above would notice a delay of the wrong sign, or one that is left out."""
    acts = predictor_module._horizon

    def another(p: LinkParams, link: Link, sample: int) -> float:
        return share * acts(p, link, sample)

    monkeypatch.setattr(predictor_module, "_horizon", another)
    assert rms_after_5_s(plant("duration_s=20", ELLIPSE, *VARYING), controller(SHARP)) > 0.004


# Echoes that stop and come back


def is_echo(frame: Frame) -> bool:
    return frame.can_id == CAN_IDS[SteeringStatus]


def test_without_echoes_the_law_is_pd_ddob_and_neither_change_is_a_jump() -> None:
    """No echo reaches the controller from 6 s to 10 s, in the midst of a curve."""
    settings = controller()
    network = ("duration_s=16", "latency.downlink.mean_s=0.15", "latency.uplink.mean_s=0.02")
    _, deaf = run(
        plant(*network), settings, lambda frame, now_ns: is_echo(frame) and 6e9 < now_ns < 10e9
    )
    _, hears = run(plant(*network), settings)
    predicts = np.array([s.law_output.network_disturbance_rad == 0.0 for s in deaf.samples])
    times_s = np.array([s.time_ns for s in deaf.samples]) * 1e-9
    timeout_s = 1e-9 * age_limits_of(settings).steering_status_ns
    assert predicts[(times_s > 1.0) & (times_s < 6.0 + timeout_s - 0.05)].all()
    settles_s = 1.0  # the filter has started anew, and is not believed at once
    assert not predicts[(times_s > 6.0 + timeout_s + 0.05) & (times_s < 10.0 + settles_s)].any()
    assert predicts[times_s > 10.1 + settles_s].all()
    steps = np.abs(np.diff([s.sent_steer_rad for s in deaf.samples]))[100:]
    usual = np.abs(np.diff([s.sent_steer_rad for s in hears.samples]))[100:]
    fade_rad_s = 0.2
    # A jump would be as large as the two laws are apart; a fade adds its own step to the usual.
    assert steps.max() < usual.max() + fade_rad_s * 0.01 + 1e-3
    errors = [s.lateral_error_m for s in deaf.samples if s.time_ns > 14e9]
    assert np.abs(errors).max() < 0.005


def test_two_laws_that_are_far_apart_meet_at_the_rate_of_the_fade() -> None:
    """Beside the path by 0.3 m they ask for 0.1 rad of difference: half a second of fading."""
    law = design_law(controller())
    far_off = history()._replace(lateral_error_m=[0.3] * 64)
    seen = LawInput(0.3, 0.0, link=Link(30, 20, 20, 30.0 * MS, True), history=far_off)
    unmeasured = seen._replace(link=Link(31, 20, 20, 30.0 * MS, False))
    params = law.params._replace(settling_samples=0)
    state: Any = law.initial_state(0.3)
    commands = []
    for told in [seen] * 300 + [unmeasured] * 300:
        state, output = law.step(params, state, told)
        commands.append(output.steer_rad)
    assert abs(commands[599] - commands[299]) > 0.05
    assert np.abs(np.diff(commands)).max() == pytest.approx(0.002)
    assert commands[300] == commands[299]


@pytest.mark.parametrize("silence_s", [0.3, 1.5])
def test_the_filter_goes_on_after_a_hold_and_starts_anew_after_a_safe_stop(
    silence_s: float,
) -> None:
    """In the midst of a curve nothing is heard for 0.3 s, which is a hold; for 1.5 s it is more."""
    is_short, end_ns = silence_s < 1.0, round((6.0 + silence_s) * 1e9)
    network = ("duration_s=12", "latency.downlink.mean_s=0.2", "latency.uplink.mean_s=0.05")
    plant_node, node = run(
        plant(*network), controller(), lambda _frame, now_ns: 6e9 < now_ns < end_ns
    )
    modes = {sample.mode for sample in node.samples if sample.time_ns > 6e9}
    assert Mode.HOLDING in modes
    assert (Mode.SAFE_STOP in modes) != is_short
    first_ns = next(s.time_ns for s in node.samples if s.time_ns > end_ns and s.mode is Mode.ACTIVE)
    predicts = [
        s.law_output.network_disturbance_rad == 0.0
        for s in node.samples
        if first_ns < s.time_ns < first_ns + 0.5e9
    ]
    assert all(predicts) == is_short
    assert any(predicts) == is_short
    if is_short:
        after_m = [s.lateral_error_m for s in plant_node.samples if 6.0 < s.time_s < 9.0]
        assert np.abs(after_m).max() < 0.02
