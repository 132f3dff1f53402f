"""The measured lag of the steering: against filterpy, against the truth, and in the predictor."""

from functools import cache

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from steer_by_wire.closed_loop.compiled.engine import CompiledRun, run_compiled
from steer_by_wire.controller.history.echo_delay import LoopDelayParams
from steer_by_wire.controller.law_interface import NO_LOOP_DELAY, History
from steer_by_wire.controller.prediction.lag_filter import (
    AS_SET,
    LAGS_S,
    NO_LAG,
    LagState,
    chosen,
    is_known,
    lag_of,
    lag_step,
    lag_to,
)
from steer_by_wire.controller.settings import ControllerSettings, controller_preset
from steer_by_wire.plant_emulator.network.latency_distributions import Distribution
from steer_by_wire.plant_emulator.network.settings import BothLatencySettings, LatencySettings
from steer_by_wire.plant_emulator.path.settings import DoubleLaneChangeSettings
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.plant_emulator.vehicle.settings import ActuatorSettings, VehicleSettings
from tests.support.runs.unguarded import UNGUARDED

PERIOD_NS = 10_000_000
LOOP_DELAY = LoopDelayParams(PERIOD_NS, PERIOD_NS, 10.0)
GAMMA = LatencySettings(model=Distribution.GAMMA, mean_s=0.1, spread_s=0.03, loss=0.05)


def plant(lag_s: float, network: LatencySettings = GAMMA, speed_m_s: float = 12.5) -> PlantSettings:
    return PlantSettings(
        duration_s=12.0,
        vehicle=VehicleSettings(speed_m_s=speed_m_s),
        path=DoubleLaneChangeSettings(kind="double_lane_change"),
        actuator=ActuatorSettings(lag_s=lag_s),
        latency=BothLatencySettings(downlink=network, uplink=LatencySettings(loss=0.1)),
        safety=UNGUARDED,
    )


def law(*, measures_lag: bool) -> ControllerSettings:
    return controller_preset(
        "highway_stiff_predictor", [f"predictor.measures_lag={str(measures_lag).lower()}"]
    )


@cache
def driven(lag_s: float) -> CompiledRun:
    return run_compiled(plant(lag_s), law(measures_lag=True))


def history_of(run: CompiledRun, lost_share: float = 0.0) -> History:
    """Every sample as the plant reports it; a lost one has the values of the one before."""
    wheel_rad, ticks = run.wheel_angle_rad.copy(), np.full(len(run.command), -1)
    ticks[run.command >= 0] = run.schedule.instants.commands[1, run.command[run.command >= 0]]
    for sample in np.flatnonzero(np.random.default_rng(5).random(len(ticks)) < lost_share):
        ticks[sample], wheel_rad[sample] = ticks[sample - 1], wheel_rad[sample - 1]
    nothing, never = [0.0] * len(ticks), [False] * len(ticks)
    sent_rad = run.sent_rad.tolist()
    return History(
        -1, -1, sent_rad, nothing, nothing, never, ticks.tolist(), never, wheel_rad.tolist()
    )


def filtered(history: History) -> LagState:
    first = lag_to(LOOP_DELAY, NO_LAG, NO_LOOP_DELAY._replace(echo_sample=0), history)
    last = NO_LOOP_DELAY._replace(echo_sample=len(history.wheel_rad) - 1)
    step = 200  # no further apart than what is forgotten
    for sample in range(step, last.echo_sample, step):
        first = lag_to(LOOP_DELAY, first, last._replace(echo_sample=sample), history)
    return lag_to(LOOP_DELAY, first, last, history)


def test_the_filter_is_filterpys() -> None:
    history = history_of(driven(0.1))
    reference = KalmanFilter(dim_x=2, dim_z=1)
    reference.F, reference.Q, reference.R = np.eye(2), np.eye(2) * 1e-7, np.array([[1e-8]])
    reference.P = np.eye(2)
    x = NO_LAG._replace(sample=200, is_received=True, variance_aa=0.9, variance_bb=0.9)
    reference.P = np.eye(2) * 0.9
    for sample in range(200, 1100):
        u0, u1 = (history.sent_rad[history.applied_tick[s]] for s in (sample, sample + 1))
        row = np.array([[history.wheel_rad[sample] - u1, u0 - u1]])
        before, x = x, lag_step(x, history)
        reference.predict()
        if x.is_received and before.is_received:
            reference.update(np.array([[history.wheel_rad[sample + 1] - u1]]), H=row)
    assert [x.alpha, x.b] == pytest.approx(reference.x[:, 0].tolist(), rel=1e-6)
    variances = [x.variance_aa, x.variance_ab, x.variance_bb]
    expected = [reference.P[0, 0], reference.P[0, 1], reference.P[1, 1]]
    assert variances == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("lag_s", LAGS_S[1:])
@pytest.mark.parametrize("lost_share", [0.0, 0.3])
def test_a_lag_is_found_to_a_tenth_and_its_gains_are_taken(lag_s: float, lost_share: float) -> None:
    x = filtered(history_of(driven(lag_s), lost_share))
    assert lag_of(0.01, x) == pytest.approx(lag_s, rel=0.1)
    assert LAGS_S[x.choice - 1] == lag_s


def test_a_steering_without_lag_is_never_taken_for_one_with() -> None:
    assert filtered(history_of(driven(0.0))).choice in (AS_SET, 1 + LAGS_S.index(0.0))


def test_what_the_steering_overrules_shows_nothing() -> None:
    history = history_of(driven(0.1))
    overruled = history._replace(is_overruled=[True] * len(history.wheel_rad))
    x = filtered(overruled)
    assert (x.alpha, x.choice) == (0.0, AS_SET)


def test_a_lag_between_two_keeps_the_gains_it_has() -> None:
    sure = NO_LAG._replace(variance_aa=1e-8)
    between_s = 0.0714
    x = sure._replace(alpha=float(np.exp(-0.01 / between_s)))
    places = {chosen(0.01, x._replace(choice=1 + place)) for place in (2, 3)}
    assert places == {3, 4}
    assert chosen(0.01, x._replace(choice=AS_SET)) == 4
    assert chosen(0.01, x._replace(choice=6)) == 4
    assert chosen(0.01, x._replace(choice=2, variance_aa=1.0)) == 2


@pytest.mark.parametrize("lag_s", LAGS_S[1:])
def test_a_lag_is_known_once_it_deviates_by_a_fifth(lag_s: float) -> None:
    alpha = float(np.exp(-0.01 / lag_s))
    deviation_of_a_fifth = 0.2 * lag_s * alpha * 0.01 / lag_s**2  # of alpha: dα/dT = α P / T²
    x = NO_LAG._replace(alpha=alpha)
    assert is_known(x._replace(variance_aa=(0.99 * deviation_of_a_fifth) ** 2))
    assert not is_known(x._replace(variance_aa=(1.01 * deviation_of_a_fifth) ** 2))


def test_no_lag_is_known_once_two_deviations_stay_below_a_fifth() -> None:
    x = NO_LAG._replace(alpha=0.02)
    assert is_known(x._replace(variance_aa=0.0899**2))
    assert not is_known(x._replace(variance_aa=0.0901**2))


def test_without_a_lag_measuring_it_changes_nothing() -> None:
    measured, not_measured = (
        run_compiled(plant(0.0), law(measures_lag=measures)) for measures in (True, False)
    )
    assert (measured.sent_rad == not_measured.sent_rad).all()


def test_a_lag_that_loses_the_path_at_60_km_h_is_measured_and_driven() -> None:
    asked = plant(0.2, LatencySettings(mean_s=0.15), 60.0 / 3.6)
    asked = asked.model_copy(
        update={
            "duration_s": 20.0,
            "path": DoubleLaneChangeSettings(kind="double_lane_change", length_m=90.0),
            "vehicle": VehicleSettings(speed_m_s=60.0 / 3.6, virtual_mass_kg=1600.0),
        }
    )
    largest_m = {
        measures: float(
            np.abs(run_compiled(asked, law(measures_lag=measures)).lateral_error_m).max()
        )
        for measures in (True, False)
    }
    assert 0.03 < largest_m[True] < 0.06
    assert largest_m[False] > 5.0 * largest_m[True]
