"""The delay from command and response: on made signals, for each estimator and for the echo."""

import math
import random
from collections.abc import Callable

import pytest

from steer_by_wire.controller.delay_estimation.comparison_filters import design_filters
from steer_by_wire.controller.delay_estimation.delay_estimator import (
    DelayEstimate,
    DelayEstimationParams,
    DelayEstimator,
    Estimate,
    combined,
)
from steer_by_wire.controller.delay_estimation.lag_fit import LagFit, LagGrid, Peak
from steer_by_wire.controller.filters.nominal_model import NominalVehicle
from steer_by_wire.controller.law_interface import VehicleReading
from steer_by_wire.controller.node.reported_delay import EchoDelay
from steer_by_wire.runtime.node import NS_PER_S

PERIOD_S = 0.01
PERIOD_NS = 10_000_000
TOLERANCE_S = 0.01
SPEED_M_S = 5.0 / 3.6
VEHICLE = NominalVehicle(3300.0, 3728.0, 190e3, 500e3, 1.3008, 1.5453, 2.0, 1.0)
PARAMS = DelayEstimationParams(PERIOD_S, VEHICLE, 1.0, 10.0, TOLERANCE_S, 0.95)
GRID = LagGrid(0.02, 55, 10.0)
NO_CURVATURE_1_M = 0.0


def steer_rad(time_s: float) -> float:
    """A command with slow and swift parts, 0 before the start."""
    if time_s < 0.0:
        return 0.0
    return 0.05 * math.sin(0.9 * time_s) + 0.03 * math.sin(2.3 * time_s)


# The fit


def fitted(
    command: Callable[[float], float], delay_s: float, noise: float, steps: int = 1000
) -> Peak | None:
    """Fit a copy of the command that is late, scaled, shifted and noisy."""
    source = random.Random(3)
    fit = LagFit(GRID)
    peak = None
    for step in range(steps):
        time_s = step * GRID.step_s
        response = 0.7 * command(time_s - delay_s) + 0.2 + source.gauss(0.0, noise)
        fit.push([command(time_s)], [response], [True])
        if step % 5 == 4:
            peak = fit.peak
    return peak


@pytest.mark.parametrize("delay_s", [0.0, 0.08, 0.087, 0.25, 0.4, 0.9])
@pytest.mark.parametrize("noise", [0.0, 0.003])
def test_the_fit_finds_a_lag_between_the_steps_of_its_grid(delay_s: float, noise: float) -> None:
    peak = fitted(steer_rad, delay_s, noise)
    assert peak is not None
    assert peak.gain == pytest.approx(0.7, rel=0.02)
    # The parabola between two lags is right to a twentieth of the grid's step.
    assert abs(peak.lag_s - delay_s) <= 3.0 * peak.deviation_s + 1e-3
    # Till a long delay has passed the fit goes wrong, which its deviation remembers for a while.
    if delay_s <= 0.4:
        assert peak.deviation_s < (1e-3 if noise == 0.0 else 6e-3)


def test_the_deviation_is_that_of_many_fits() -> None:
    lags_s, deviations_s = [], []
    for seed in range(20):
        source = random.Random(seed)
        fit = LagFit(GRID)
        for step in range(700):
            time_s = step * GRID.step_s
            response = steer_rad(time_s - 0.2) + source.gauss(0.0, 0.01)
            fit.push([steer_rad(time_s)], [response], [True])
            peak = fit.peak if step % 50 == 49 else None
        assert peak is not None
        lags_s.append(peak.lag_s)
        deviations_s.append(peak.deviation_s)
    spread_s = math.sqrt(sum((lag_s - 0.2) ** 2 for lag_s in lags_s) / len(lags_s))
    reported_s = sum(deviations_s) / len(deviations_s)
    assert 0.5 * spread_s < reported_s < 2.0 * spread_s


def test_nothing_is_found_in_a_constant_or_outside_the_grid() -> None:
    assert fitted(lambda _: 0.0, 0.1, 0.0) is None
    for noise in (0.0, 0.001):
        fit, source = LagFit(GRID), random.Random(1)
        for step in range(1000):
            fit.push([0.1], [0.07 + source.gauss(0.0, noise)], [step > 60])
        assert fit.peak is None
    late = fitted(steer_rad, 1.3, 0.0)
    assert late is None or late.correlation < 0.99
    assert fitted(steer_rad, 0.1, 0.0, steps=20) is None


def test_pairs_that_do_not_count_keep_the_time() -> None:
    fit = LagFit(GRID)
    for step in range(1500):
        time_s = step * GRID.step_s
        counts = step % 100 < 50
        response = steer_rad(time_s - 0.15) if counts else 99.0
        late = (step - 2) % 100 < 50  # the response waits two steps
        fit.push([steer_rad(time_s)], [response], [counts and late and step > 60])
    peak = fit.peak
    assert peak is not None
    assert peak.lag_s == pytest.approx(0.15, abs=1e-3)


def test_information_ages_where_nothing_moves() -> None:
    fit = LagFit(GRID)
    ages_s = []
    for step in range(2500):
        time_s = min(step * GRID.step_s, 20.0)
        fit.push([steer_rad(time_s)], [steer_rad(time_s - 0.1)], [True])
        peak = fit.peak if step % 250 == 249 else None
        if peak is not None:
            ages_s.append(peak.age_s)
    assert ages_s[-1] > ages_s[3] + 20.0


# Both estimators, each from its own sensor


def simulated(
    delay_s: float,
    duration_s: float = 40.0,
    yaw_noise_rad_s: float = 0.0,
    error_noise_m: float = 0.0,
    command: Callable[[float], float] = steer_rad,
    yaw_gain: float = 1.0,
    error_gain: float = 1.0,
    error_delay_s: float | None = None,
) -> DelayEstimate:
    """Drive a single-track vehicle, integrated in small steps, in open loop on a straight road."""
    m, j, c_f, c_r, l_f, l_r, l_s, _ = VEHICLE
    v = SPEED_M_S
    source = random.Random(5)
    estimator = DelayEstimator(PARAMS)
    beta = r = psi = y = 0.0
    h = PERIOD_S / 10
    errors, rates = [], []
    ticks = round(duration_s / PERIOD_S)
    for tick in range(ticks):
        errors.append(y)
        rates.append(r)
        for _ in range(10):
            delta = command(tick * PERIOD_S)
            front, rear = delta - beta - l_f * r / v, -beta + l_r * r / v
            beta += h * ((c_f * front + c_r * rear) / (m * v) - r)
            r += h * (c_f * l_f * front - c_r * l_r * rear) / j
            y += h * (v * (psi + beta) + l_s * r)
            psi += h * r
    yaw_late = round(delay_s / PERIOD_S)
    error_late = round((delay_s if error_delay_s is None else error_delay_s) / PERIOD_S)
    for tick in range(ticks):
        rate = yaw_gain * rates[max(tick - yaw_late, 0)] + source.gauss(0.0, yaw_noise_rad_s)
        error = error_gain * errors[max(tick - error_late, 0)] + source.gauss(0.0, error_noise_m)
        vehicle = VehicleReading(v, rate, NO_CURVATURE_1_M)
        held_rad = command((tick - 1) * PERIOD_S)
        estimator.on_tick((held_rad, error, 0.0, vehicle, 0.0))
    return estimator.estimate


@pytest.mark.parametrize("delay_s", [0.08, 0.25, 0.4])
def test_each_estimator_finds_the_delay_of_a_vehicle(delay_s: float) -> None:
    estimate = simulated(delay_s)
    assert estimate.is_observable
    for part in (estimate.by_disturbance, estimate.by_correlation):
        assert part is not None
        # The signals here are sampled at the ticks, at one end of the period that a hold lasts.
        assert part.delay_s == pytest.approx(delay_s, abs=7e-3)


def test_the_confidence_falls_with_noise() -> None:
    clean, little, much = (
        simulated(0.16, yaw_noise_rad_s=noise, error_noise_m=4.0 * noise).confidence
        for noise in (0.0, 0.01, 0.1)
    )
    assert clean > little > much
    assert clean > 0.99
    assert much < 0.5


def test_a_noisy_sensor_leaves_the_delay_to_the_other() -> None:
    by_error = simulated(0.16, yaw_noise_rad_s=0.3)
    by_yaw = simulated(0.16, error_noise_m=0.3)
    for estimate in (by_error, by_yaw):
        assert estimate.is_observable
        assert estimate.delay_s == pytest.approx(0.16, abs=TOLERANCE_S)


def test_two_that_contradict_each_other_are_not_observable() -> None:
    estimate = simulated(0.10, error_delay_s=0.25)
    assert estimate.by_disturbance is not None
    assert estimate.by_correlation is not None
    assert not estimate.is_observable
    assert estimate.confidence == 0.0


def test_a_response_of_the_wrong_size_or_sign_is_not_the_commands() -> None:
    for gain in (-1.0, 0.3, 3.0):
        assert simulated(0.1, duration_s=25.0, yaw_gain=gain).by_correlation is None
        assert simulated(0.1, duration_s=25.0, error_gain=gain).by_disturbance is None


def test_without_excitation_nothing_is_observable() -> None:
    for command in (lambda _: 0.0, lambda _: 0.05):
        estimate = simulated(0.1, command=command, yaw_noise_rad_s=1e-3, error_noise_m=1e-3)
        assert not estimate.is_observable
        assert estimate.delay_s == 0.0 or estimate.confidence < 0.95


def test_combining_weighs_by_variance_and_never_sharpens() -> None:
    one, other = Estimate(0.100, 0.003), Estimate(0.106, 0.006)
    both = combined(one, other)
    assert both is not None
    assert both.delay_s == pytest.approx(0.100 + 0.006 / 5.0)
    assert both.deviation_s == pytest.approx(0.003 + 0.003 / 5.0)
    assert combined(one, None) == one
    assert combined(None, other) == other
    assert combined(None, None) is None
    assert combined(one, Estimate(0.13, 0.003)) is None


def test_old_measurements_and_a_vehicle_at_rest_do_not_count() -> None:
    for speed_m_s, age_s in ((SPEED_M_S, 1.0), (0.0, 0.0), (0.1, 0.0)):
        estimator = DelayEstimator(PARAMS)
        for tick in range(1000):
            rate = 0.4 * steer_rad((tick - 10) * PERIOD_S)
            vehicle = VehicleReading(speed_m_s, rate, 0.0)
            estimator.on_tick((steer_rad(tick * PERIOD_S), 0.0, age_s, vehicle, age_s))
        assert not estimator.estimate.is_observable
        assert estimator.estimate.by_correlation is None


def test_a_vehicle_that_is_unstable_at_its_speed_has_no_filters() -> None:
    oversteering = VEHICLE._replace(
        front_cornering_stiffness_n_rad=500e3, rear_cornering_stiffness_n_rad=190e3
    )
    assert design_filters(oversteering._replace(speed_m_s=1.0), PERIOD_S) is not None
    assert design_filters(oversteering._replace(speed_m_s=40.0), PERIOD_S) is None


# The echo


def test_the_echo_measures_down_and_up_less_half_a_period() -> None:
    echo = EchoDelay(PERIOD_NS, 500_000_000, 300_000_000)
    assert echo.delay_s(0) is None
    for counter in range(100):
        now_ns = counter * PERIOD_NS
        # Sent 5 ms after the tick, echoed 12 periods after it and 3 ms.
        sent_ns = now_ns - 12 * PERIOD_NS + 5_000_000
        echo.on_echo(sent_ns, now_ns + 3_000_000)
    end_ns = 100 * PERIOD_NS
    assert echo.delay_s(end_ns) == pytest.approx(0.118 - 0.005)
    assert echo.delay_s(end_ns + NS_PER_S) is None
