"""The predictor's parts against independent views: model, commands in effect, prediction."""

import math
from itertools import chain, pairwise

import numpy as np
import pytest

from steer_by_wire.controller.history.echo_delay import LoopDelayParams
from steer_by_wire.controller.law_interface import LoopDelay
from steer_by_wire.controller.laws.predictor import design_predictor
from steer_by_wire.controller.prediction.gains_over_speed import (
    EstimatorSettings,
    Feedback,
    design_schedule,
    together,
)
from steer_by_wire.controller.prediction.prediction import predict, steer_for
from steer_by_wire.controller.prediction.vehicle_kalman_filter import (
    DISCARDED_AFTER,
    Correction,
    EstimatorState,
    VehicleGains,
    command_from,
    estimator_at_rest,
    model_step,
    start_estimate,
)
from steer_by_wire.plant_emulator.vehicle.exact_propagation import (
    augmented_matrix as emulator_matrix,
)
from steer_by_wire.plant_emulator.vehicle.exact_propagation import (
    propagate,
    table_rows,
    transition_table,
)
from steer_by_wire.plant_emulator.vehicle.single_track_model import VehicleParams
from tests.support.loops.own_vehicle import VEHICLE
from tests.support.loops.predictor_law import SENT, controller, history
from tests.support.suite.combinations import sampled

MS = 1_000_000
PERIOD_NS = 10 * MS
LOOP_DELAY = LoopDelayParams(PERIOD_NS, PERIOD_NS, 50.0)
SPEEDS = (0.5, 1.39, 1.94, 8.0, 16.7)


def gains(speed_m_s: float, lag_s: float = 0.0, sensor_period_s: float = 0.01) -> VehicleGains:
    """Return the gains at one speed, which is made the lowest of the table."""
    settings = EstimatorSettings(actuator_lag_s=lag_s, speed_m_s_min=speed_m_s, speed_m_s_max=80.0)
    schedule = design_schedule(settings, VEHICLE, 0.01, sensor_period_s, Feedback(1.0, 0.0))
    return together([schedule])(speed_m_s)[0]


def numbers(of: VehicleGains) -> np.ndarray:
    """Return all gains in one row."""
    return np.array([*of[:-1], *chain(*of.corrections)])


# The model


ANY_STATE = EstimatorState(7, 0.02, -0.1, 0.05, -0.3, 0.04, 0.01, 0.06)


@pytest.mark.parametrize("speed_m_s", SPEEDS)
@pytest.mark.parametrize("lag_s", [0.0, 0.02, 0.27])
def test_the_model_is_that_of_the_plant_emulator(speed_m_s: float, lag_s: float) -> None:
    values = {**VEHICLE.model_dump(), "speed_m_s": speed_m_s}
    vehicle = VehicleParams(**{name: values[name] for name in VehicleParams._fields})
    table = table_rows(transition_table(emulator_matrix(vehicle, 1.0 / lag_s if lag_s else 0.0)))
    g, x = gains(speed_m_s, lag_s), ANY_STATE
    d = x.offset_rad
    wheel = (x.wheel_rad + d, (0.2 - x.wheel_rad) / lag_s) if lag_s else (0.2 + d, 0.0)
    z = (*x[1:5], *wheel, x.curvature_1_m, 0.0, 0.0, 0.0)
    for _ in range(300):
        x = model_step(g, x, 0.2)
        z = propagate(table, 0, z, PERIOD_NS)
    np.testing.assert_allclose(x[1:5], z[:4], rtol=1e-9)
    if lag_s:
        assert x.wheel_rad == pytest.approx(z[4] - d, rel=1e-9)


@pytest.mark.parametrize("lag_s", [0.0, 0.27])
def test_a_steering_offset_that_is_known_leaves_no_error(lag_s: float) -> None:
    g = gains(1.39, lag_s)
    x = EstimatorState(0, 0.0, 0.0, 0.1, 0.5, 0.0, 0.03, 0.0)
    for _ in range(6000):
        x = model_step(g, x, steer_for(g, x, math.inf))
    assert abs(x.lateral_error_m) < 1e-9
    assert x.wheel_rad == pytest.approx(-0.03, abs=1e-9)


def test_half_way_between_two_speeds_of_the_table_no_gain_is_off_by_more_than_3_percent() -> None:
    """5 for K after a gap; that much only where one crosses zero; of the larger neighbour."""
    settings = EstimatorSettings()
    schedule = design_schedule(settings, VEHICLE, 0.01, 0.01, Feedback(1.0, 0.0))
    gains_at = together([schedule])
    of_settings = [v for v in schedule.speeds_m_s if v < 1.01 * settings.speed_m_s_max]
    assert len(of_settings) > 40
    limits = np.full(schedule.rows.shape[1], 0.05)
    limits[: len(VehicleGains._fields) - 1 + len(Correction._fields)] = 0.03
    for low, high in sampled([*pairwise(of_settings)][::3], pairwise(of_settings)):
        speed_m_s = 0.5 * (low + high)
        off = np.abs(numbers(gains_at(speed_m_s)[0]) - numbers(gains(speed_m_s)))
        larger = np.maximum(*(np.abs(numbers(gains_at(end)[0])) for end in (low, high)))
        assert (off <= limits * larger).all()


def test_beyond_the_speeds_of_the_settings_the_weight_falls_with_the_square_of_the_speed() -> None:
    settings, feedback = EstimatorSettings(), Feedback(1.0, 0.0)
    limited = feedback._replace(speed_m_s_max=settings.speed_m_s_max)
    schedule = design_schedule(settings, VEHICLE, 0.01, 0.01, limited)
    unlimited = design_schedule(settings, VEHICLE, 0.01, 0.01, feedback)
    at = [speed <= 1.01 * settings.speed_m_s_max for speed in schedule.speeds_m_s]
    np.testing.assert_array_equal(schedule.rows[: sum(at)], unlimited.rows[: sum(at)])
    assert schedule.speeds_m_s[-1] > 3.0 * settings.speed_m_s_max
    last = schedule.speeds_m_s[-1]
    weight = (settings.speed_m_s_max / last) ** 2
    beyond = settings.model_copy(update={"speed_m_s_min": last, "speed_m_s_max": 2.0 * last})
    expected = design_schedule(beyond, VEHICLE, 0.01, 0.01, Feedback(weight, 0.0, last))
    np.testing.assert_allclose(schedule.rows[-1], expected.rows[0], rtol=1e-6)


# Which command acts from a sample to the next


def expected_mean(
    begin_ns: float, loop_delay: LoopDelayParams, first_tick: int, last_tick: int
) -> float:
    """Return the mean over a sensor period by looking every microsecond."""
    times_ns = begin_ns + (np.arange(10_000) + 0.5) * loop_delay.sensor_period_ns / 10_000
    ticks = np.clip(np.floor(times_ns / loop_delay.period_ns), first_tick, last_tick).astype(int)
    return float(np.mean([SENT[tick] if tick >= 0 else 0.0 for tick in ticks]))


def test_where_echoes_name_one_command_it_is_that_and_of_two_half_of_each() -> None:
    loop_delay = LoopDelay(30, 20, 20, 30.0 * MS, True)
    assert command_from(LOOP_DELAY, loop_delay, history(lambda _: 12), 10) == SENT[12]
    half_of_each = pytest.approx(0.5 * (SENT[7] + SENT[8]))
    assert command_from(LOOP_DELAY, loop_delay, history(), 10) == half_of_each


def test_where_the_steering_overrules_its_command_it_is_the_wheel() -> None:
    loop_delay = LoopDelay(30, 20, 20, 30.0 * MS, True)
    wheel = {10: 0.5, 11: 0.3, 12: 0.2}
    seen = history(lambda _: 12, wheel)
    assert command_from(LOOP_DELAY, loop_delay, seen, 9) == pytest.approx(0.5 * (SENT[12] + 0.5))
    assert command_from(LOOP_DELAY, loop_delay, seen, 10) == pytest.approx(0.4)
    assert command_from(LOOP_DELAY, loop_delay, seen, 12) == pytest.approx(0.5 * (0.2 + SENT[12]))
    assert command_from(LOOP_DELAY, loop_delay, seen, 13) == SENT[12]


@pytest.mark.parametrize("delay_ms", [0.0, 20.0, 30.0, 33.7, 35.0, 78.2])
@pytest.mark.parametrize(("period_ms", "sensor_period_ms"), [(10, 10), (5, 10), (10, 7), (20, 10)])
def test_a_command_that_no_echo_has_shown_is_expected_after_the_delay(
    delay_ms: float, period_ms: int, sensor_period_ms: int
) -> None:
    p = LoopDelayParams(period_ms * MS, sensor_period_ms * MS, 50.0)
    echo_sample = 20
    earliest = int((echo_sample * sensor_period_ms - delay_ms) // period_ms)
    for sample in range(echo_sample, echo_sample + 6):
        loop_delay = LoopDelay(earliest + 30, sample, echo_sample, delay_ms * MS, True)
        seen = command_from(p, loop_delay, history(lambda _: earliest), sample)
        begin_ns = sample * p.sensor_period_ns - delay_ms * MS
        expected = expected_mean(begin_ns, p, earliest, loop_delay.tick - 1)
        assert seen == pytest.approx(expected, abs=2e-4), sample


# Starting, and predicting


def test_an_estimate_begins_at_the_newest_sample_with_echo_and_measurement() -> None:
    h = history()._replace(lateral_error_m=[0.5] * 64, heading_error_rad=[0.1] * 64)
    loop_delay = LoopDelay(30, 22, 20, 30.0 * MS, True)
    assert start_estimate(estimator_at_rest(9.0), loop_delay, h) == EstimatorState(
        20, 0.0, 0.0, 0.1, 0.5, 0.0, 0.0, 0.0
    )


def test_an_estimate_goes_on_through_a_gap_and_begins_anew_after_a_long_one() -> None:
    x = EstimatorState(20, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7)
    near, far = 20 + DISCARDED_AFTER, 21 + DISCARDED_AFTER
    assert start_estimate(x, LoopDelay(400, near, near, 0.0, True), history()) == x
    anew = start_estimate(x, LoopDelay(400, far, far, 0.0, True), history())
    assert anew == EstimatorState(far, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("horizon", [0.0, 1.0, 2.5, 7.25])
def test_a_prediction_is_the_model_run_on_and_linear_between_two_samples(horizon: float) -> None:
    p = design_predictor(controller()).at(1.39)
    loop_delay = LoopDelay(40, 20, 20, 30.0 * MS, True)
    x = ANY_STATE._replace(sample=20)
    states = [x]
    for _ in range(9):
        last = states[-1]
        states.append(
            model_step(p.gains, last, command_from(LOOP_DELAY, loop_delay, history(), last.sample))
        )
    low, part = int(horizon), horizon % 1.0
    expected = (1.0 - part) * np.array(states[low]) + part * np.array(states[low + 1])
    found = predict(p.loop_delay, p.gains, x, loop_delay, history(), horizon)
    np.testing.assert_allclose(found[1:], expected[1:], rtol=1e-12)
