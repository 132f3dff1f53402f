"""The delay from command and response: on made signals, in the loop, and where it is not told."""

import math
import random
from collections.abc import Callable
from functools import cache
from typing import Any

import pytest
from pydantic import ValidationError

from controller.delay_estimation import (
    DelayEstimate,
    DelayEstimationParams,
    DelayEstimator,
    Estimate,
    Seen,
    combined,
)
from controller.delay_filters import design_filters
from controller.delay_settings import DelayEstimationSettings, delay_estimation_of
from controller.delay_watch import DelayWatch, EchoDelay
from controller.lag_fit import LagFit, LagGrid, Peak
from controller.law_interface import VehicleReading
from controller.law_settings import PaperEq19Settings
from controller.node import ControllerNode
from controller.nominal_model import NominalVehicle
from controller.settings import ControllerSettings
from dbc.messages import Decoded, DelayStatus, EchoState, EstimateState, decode
from plant_emulator.node import PlantNode
from plant_emulator.settings import PlantSettings
from runtime.frame import Frame
from runtime.node import NS_PER_S
from runtime.settings import load_settings, read_preset
from runtime.virtual_time import VirtualTimeExecutor

PERIOD_S = 0.01
PERIOD_NS = 10_000_000
TOLERANCE_S = 0.01
SPEED_M_S = 5.0 / 3.6
VEHICLE = NominalVehicle(3300.0, 3728.0, 195e3, 500e3, 1.3008, 1.5453, 1.912, 1.0)
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
        fit.push(command(time_s), response, counts=True)
        if step % 5 == 4:
            peak = fit.peak()
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
            fit.push(steer_rad(time_s), response, counts=True)
            peak = fit.peak() if step % 50 == 49 else None
        assert peak is not None
        lags_s.append(peak.lag_s)
        deviations_s.append(peak.deviation_s)
    spread_s = math.sqrt(sum((lag_s - 0.2) ** 2 for lag_s in lags_s) / len(lags_s))
    told_s = sum(deviations_s) / len(deviations_s)
    assert 0.5 * spread_s < told_s < 2.0 * spread_s


def test_nothing_is_found_in_a_constant_or_outside_the_grid() -> None:
    assert fitted(lambda _: 0.0, 0.1, 0.0) is None
    for noise in (0.0, 0.001):
        fit, source = LagFit(GRID), random.Random(1)
        for step in range(1000):
            fit.push(0.1, 0.07 + source.gauss(0.0, noise), counts=step > 60)
        assert fit.peak() is None
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
        fit.push(steer_rad(time_s), response, counts=counts and late and step > 60)
    peak = fit.peak()
    assert peak is not None
    assert peak.lag_s == pytest.approx(0.15, abs=1e-3)


def test_information_ages_where_nothing_moves() -> None:
    fit = LagFit(GRID)
    ages_s = []
    for step in range(2500):
        time_s = min(step * GRID.step_s, 20.0)
        fit.push(steer_rad(time_s), steer_rad(time_s - 0.1), counts=True)
        peak = fit.peak() if step % 250 == 249 else None
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
        estimator.on_tick(Seen(held_rad, error, 0.0, vehicle, 0.0))
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
            estimator.on_tick(Seen(steer_rad(tick * PERIOD_S), 0.0, age_s, vehicle, age_s))
        assert not estimator.estimate.is_observable
        assert estimator.estimate.by_correlation is None


def test_a_vehicle_that_is_unstable_at_its_speed_has_no_filters() -> None:
    oversteering = VEHICLE._replace(
        front_cornering_stiffness_n_rad=500e3, rear_cornering_stiffness_n_rad=195e3
    )
    assert design_filters(oversteering._replace(speed_m_s=1.0), PERIOD_S) is not None
    assert design_filters(oversteering._replace(speed_m_s=40.0), PERIOD_S) is None


# The echo


def test_the_echo_measures_down_and_up_less_half_a_period() -> None:
    echo = EchoDelay(PERIOD_NS, 500_000_000, 300_000_000)
    assert echo.delay_s(0) is None
    for counter in range(100):
        now_ns = counter * PERIOD_NS
        if counter >= 12:
            echo.on_echo(counter - 12, now_ns + 3_000_000)
        echo.on_sent(now_ns + 5_000_000)
    # Sent 5 ms after the tick, echoed 12 periods after it and 3 ms.
    end_ns = 100 * PERIOD_NS
    assert echo.delay_s(end_ns) == pytest.approx(0.118 - 0.005)
    echo.on_echo(60_000, end_ns)  # never sent
    assert echo.delay_s(end_ns) == pytest.approx(0.118 - 0.005)
    assert echo.delay_s(end_ns + NS_PER_S) is None


# In the loop


def plant_settings(path: dict[str, Any], corner: tuple[float, float], delay_s: float) -> Any:
    way = {"mean_s": delay_s / 2.0}
    return PlantSettings.model_validate(
        {
            "duration_s": 24.0,
            "path": path,
            "vehicle": {"speed_km_h": corner[0], "virtual_mass_kg": corner[1]},
            "latency": {"downlink": way, "uplink": way},
        }
    )


def controller_settings(law: str, *overrides: str) -> ControllerSettings:
    preset = read_preset("controller.presets", f"practical_{law}")
    return load_settings(ControllerSettings, preset, None, overrides)


class Run:
    """One run in virtual time, and what the wire carried."""

    def __init__(self, plant: PlantSettings, controller: ControllerSettings) -> None:
        self.told: list[DelayStatus] = []
        self.steer: list[bytes] = []
        self.node = ControllerNode(controller, 0)
        plant_node = PlantNode(plant, 0, samples_max=0)
        executor = VirtualTimeExecutor((plant_node, self.node), None, self._on_wire)
        until_ns = NS_PER_S
        while not executor.finished:
            executor.run(until_ns)
            until_ns += NS_PER_S

    def _on_wire(self, _time_ns: int, _sender: int, frame: Frame) -> None:
        decoded = decode(frame)
        assert isinstance(decoded, Decoded)
        if isinstance(decoded.message, DelayStatus):
            self.told.append(decoded.message)
        elif frame.can_id == 0x100:
            self.steer.append(frame.data)

    @property
    def observable(self) -> list[DelayStatus]:
        return [one for one in self.told if one.estimate_state is EstimateState.OBSERVABLE]


@cache
def run(law: str, path: str, speed_km_h: float, mass_kg: float, delay_s: float) -> Run:
    plant = plant_settings(PATHS[path], (speed_km_h, mass_kg), delay_s)
    return Run(plant, controller_settings(law))


PATHS: dict[str, dict[str, Any]] = {
    "lane change": {"kind": "double_lane_change", "start_m": 2.0},
    "ellipse": {"kind": "ellipse", "semi_major_axis_m": 60.0, "semi_minor_axis_m": 30.0},
    "straight": {"kind": "straight"},
    "circle": {"kind": "circle", "radius_m": 50.0},
}


@pytest.mark.parametrize(
    ("law", "path", "speed_km_h", "mass_kg", "delay_s"),
    [
        ("pd", "lane change", 4.0, 1600.0, 0.08),
        ("pd_ddob", "lane change", 7.0, 5000.0, 0.25),
        ("pd_cdob", "ellipse", 7.0, 5000.0, 0.08),
        ("predictor", "ellipse", 4.0, 1600.0, 0.25),
    ],
)
def test_while_observable_it_is_right_to_a_control_period(
    law: str, path: str, speed_km_h: float, mass_kg: float, delay_s: float
) -> None:
    told = run(law, path, speed_km_h, mass_kg, delay_s)
    assert len(told.observable) > 0.15 * len(told.told)
    errors_s = [one.estimated_delay_s - delay_s for one in told.observable]
    assert max(map(abs, errors_s)) <= TOLERANCE_S + 1e-9
    assert all(one.confidence >= 0.945 for one in told.observable)


def test_the_echo_is_told_beside_it_within_half_a_period() -> None:
    told = run("pd", "lane change", 4.0, 1600.0, 0.08).told
    assert told[0].echo_state is EchoState.UNKNOWN
    assert told[-1].echo_state is EchoState.KNOWN
    assert told[-1].echo_delay_s == pytest.approx(0.08, abs=0.0055)


def test_on_a_straight_road_nothing_is_observable() -> None:
    told = run("pd", "straight", 5.0, 2000.0, 0.08)
    assert told.observable == []
    assert {one.estimate_state for one in told.told} == {EstimateState.NOT_OBSERVABLE}
    report = told.node.report()["delay"]
    assert report["estimate_s"] is None
    assert report["observable_share"] == 0.0
    assert report["first_observable_s"] is None


def test_in_a_steady_circle_what_was_observable_at_its_start_is_so_no_more() -> None:
    plant = plant_settings(PATHS["circle"], (5.0, 2000.0), 0.08)
    told = Run(plant.model_copy(update={"duration_s": 60.0}), controller_settings("pd"))
    assert told.observable
    late = told.told[-200:]
    assert {one.estimate_state for one in late} == {EstimateState.NOT_OBSERVABLE}
    # What it was remains told.
    assert late[-1].estimated_delay_s == pytest.approx(0.08, abs=TOLERANCE_S)


def test_the_report_has_what_the_bus_was_told() -> None:
    told = run("pd_ddob", "lane change", 7.0, 5000.0, 0.25)
    report = told.node.report()["delay"]
    share = len(told.observable) / len(told.told)
    assert report["observable_share"] == pytest.approx(share, abs=0.02)
    assert report["estimate_s"] == pytest.approx(told.told[-1].estimated_delay_s, abs=5e-4)
    assert report["echo_s"] == pytest.approx(told.told[-1].echo_delay_s, abs=5e-4)


def test_switched_off_it_is_off_and_the_commands_are_the_same_to_the_last_bit() -> None:
    plant = plant_settings(PATHS["lane change"], (4.0, 1600.0), 0.08)
    off = Run(plant, controller_settings("pd", "delay_estimation.enabled=false"))
    assert {one.estimate_state for one in off.told} == {EstimateState.OFF}
    assert {one.confidence for one in off.told} == {0.0}
    assert off.told[-1].echo_state is EchoState.KNOWN
    assert off.steer == run("pd", "lane change", 4.0, 1600.0, 0.08).steer
    assert off.node.report()["delay"]["estimate_state"] == "off"


def test_without_a_nominal_vehicle_it_is_off() -> None:
    table = DelayEstimationSettings()
    assert delay_estimation_of(table, None, PERIOD_NS) is None
    assert delay_estimation_of(table, PaperEq19Settings(kind="paper_eq19"), PERIOD_NS) is None
    watch = DelayWatch(None, EchoDelay(PERIOD_NS, NS_PER_S, NS_PER_S))
    watch.on_tick(0, 0, 0.0, 0.0)
    assert watch.status(0) == DelayStatus(0.0, 0.0, EchoState.UNKNOWN, EstimateState.OFF, 0.0)


@pytest.mark.parametrize(
    "table",
    [
        {"delay_s_max": 0.0},
        {"delay_s_max": 3.0},
        {"window_s": 0.0},
        {"tolerance_ms": 0.0},
        {"confidence_min": 1.0},
        {"mass_over_nominal": -1.0},
        {"unknown": 1},
    ],
)
def test_settings_that_make_no_sense_are_refused(table: dict[str, float]) -> None:
    with pytest.raises(ValidationError):
        DelayEstimationSettings.model_validate(table)
