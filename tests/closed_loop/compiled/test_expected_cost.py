"""The expected cost under random latency, against runs: constant, drawn, on and off the grid."""

import numpy as np
import pytest

from steer_by_wire.closed_loop.compiled.engine import run_batch
from steer_by_wire.closed_loop.compiled.schedule import schedule_run
from steer_by_wire.closed_loop.studies.factors import replicate_seed
from steer_by_wire.controller.settings import ControllerSettings, controller_preset
from steer_by_wire.plant_emulator.network.latency_distributions import QUANTILES, Distribution
from steer_by_wire.plant_emulator.network.settings import LatencySettings
from steer_by_wire.plant_emulator.settings import PlantSettings, plant_preset
from steer_by_wire.runtime.settings import SettingsError
from tests.support.expected_cost.monte_carlo import monte_carlo_costs, on_grid
from tests.support.expected_cost.propagation import Rounding, expected_cost, latency_cdf

GAMMA = "latency.downlink={model='gamma',mean_s=0.08,spread_s=0.03}"
STRAIGHT = "path={kind='straight'}"
NOISE = "sensor_noise.lateral_error_m=0.02"
RUNS = 60
PERIOD_NS = 10_000_000


def plant_settings(*overrides: str, duration_s: float = 10.0) -> PlantSettings:
    ellipse = "path={kind='ellipse',semi_major_axis_m=60,semi_minor_axis_m=30}"
    return plant_preset("paper_nominal", [ellipse, f"duration_s={duration_s}", *overrides])


def controller_settings(law: str) -> ControllerSettings:
    """A law whose limits are never met: only then is a run linear."""
    wide = ("limits.steer_rad_max=1.3", "limits.steer_rate_rad_s_max=1000")
    return controller_preset(f"practical_{law}", wide)


def seeds(count: int) -> list[int]:
    """Return those of the replicates of a study with seed 1."""
    return [replicate_seed(1, replicate) for replicate in range(count)]


PD, DDOB = controller_settings("pd"), controller_settings("pd_ddob")


@pytest.mark.parametrize("law", ["pd", "pd_dob", "pd_cdob", "pd_ddob"])
@pytest.mark.parametrize("latency_ms", [0, 80, 200])
def test_without_randomness_it_is_the_cost_of_the_one_run(law: str, latency_ms: int) -> None:
    plant = plant_settings(f"latency.downlink.mean_s={latency_ms / 1e3}", duration_s=4.0)
    controller = controller_settings(law)
    run, expected = run_batch(plant, controller), expected_cost(plant, controller)
    # What is left is the resolution of the signals: 10 um and 10 urad.
    np.testing.assert_allclose(expected.error_mean_m, run.lateral_error_m, atol=3e-5)
    np.testing.assert_allclose(expected.time_s, run.time_s)
    cost_m2 = float(np.mean(run.lateral_error_m**2))
    assert expected.mean_square_m2 == pytest.approx(cost_m2, rel=2e-3)
    assert expected.error_deviation_m.max() < 1e-6
    assert expected.variance_m4 < 1e-9 * cost_m2**2


def test_the_lag_of_the_actuator_and_disturbances_are_part_of_the_loop() -> None:
    steps = "[{at_s=1,steering_offset_rad=0.02,side_force_n=300},{at_s=2.004,yaw_moment_n_m=500}]"
    plant = plant_settings(
        *("actuator.lag_s=0.2", "latency.downlink.mean_s=0.1", f"disturbance.steps={steps}"),
        duration_s=4.0,
    )
    run, expected = run_batch(plant, PD), expected_cost(plant, PD)
    np.testing.assert_allclose(expected.error_mean_m, run.lateral_error_m, atol=3e-5)


def test_steps_within_the_period_take_a_constant_latency_of_parts_of_it() -> None:
    plant = plant_settings("latency.downlink.mean_s=0.0825", duration_s=4.0)
    run, expected = run_batch(plant, PD), expected_cost(plant, PD, 4)
    np.testing.assert_allclose(expected.error_mean_m, run.lateral_error_m, atol=3e-5)


@pytest.mark.parametrize(
    "overrides",
    [
        (GAMMA,),
        ("latency.downlink={model='uniform',mean_s=0.08,spread_s=0.04,loss=0.1}",),
        (GAMMA, STRAIGHT, NOISE),
        (GAMMA, NOISE),
    ],
    ids=["80 ± 30 ms", "lossy", "white noise", "path and noise"],
)
def test_the_mean_cost_of_many_runs_is_the_expected_one(overrides: tuple[str, ...]) -> None:
    """Latencies rounded up to control periods, for which the expected cost is exact."""
    plant = plant_settings(*overrides)
    monte_carlo = monte_carlo_costs(plant, [PD, DDOB], seeds(RUNS), is_on_grid=True)
    for controller, found in zip([PD, DDOB], monte_carlo, strict=True):
        expected = expected_cost(plant, controller)
        off = expected.mean_square_m2 - found.mean_square_m2
        assert found.limited == 0
        assert abs(off) < 4.0 * found.standard_error_m2
        # And the standard error is small enough for that to mean something.
        share = 0.05 if NOISE in overrides else 1e-3
        assert found.standard_error_m2 < share * expected.mean_square_m2
        # Of so few runs the variance is known to a factor of about 1.4.
        assert 0.5 < found.variance_m4 / expected.variance_m4 < 2.0


def test_another_latency_is_distinguished_from_the_right_one_by_many_standard_errors() -> None:
    plant = plant_settings(GAMMA)
    (found,) = monte_carlo_costs(plant, [DDOB], seeds(RUNS), is_on_grid=True)
    other = expected_cost(plant_settings("latency.downlink.mean_s=0.08"), DDOB)
    assert abs(other.mean_square_m2 - found.mean_square_m2) > 10.0 * found.standard_error_m2


def test_off_the_grid_steps_within_the_period_come_near_and_rounding_up_does_not() -> None:
    plant = plant_settings(GAMMA)
    (found,) = monte_carlo_costs(plant, [DDOB], seeds(RUNS), is_on_grid=False)
    fine = expected_cost(plant, DDOB, 4, Rounding.NEAREST).mean_square_m2
    rounded_up = expected_cost(plant, DDOB).mean_square_m2
    assert abs(fine - found.mean_square_m2) < 4.0 * found.standard_error_m2
    assert rounded_up - found.mean_square_m2 > 4.0 * found.standard_error_m2
    assert rounded_up == pytest.approx(found.mean_square_m2, rel=0.01)


def test_a_run_that_meets_a_limit_is_reported() -> None:
    narrow = DDOB.model_copy(
        update={"limits": DDOB.limits.model_copy(update={"steer_rad_max": 0.01})}
    )
    found = monte_carlo_costs(plant_settings(GAMMA), [DDOB, narrow], seeds(3), is_on_grid=True)
    assert [each.limited for each in found] == [0, 3]


def test_on_the_grid_every_command_arrives_at_a_tick_and_none_earlier_than_it_would() -> None:
    plant = plant_settings(GAMMA)
    plan = schedule_run(plant, PD)
    rounded = on_grid(plant, PD, plan)
    assert np.all(rounded.command_due_ns % PERIOD_NS == 0)
    assert np.all(np.diff(rounded.command_tick) > 0)
    latency_ns = dict(zip(plan.command_tick.tolist(), plan.command_latency_ns, strict=True))
    for tick, new_ns in zip(rounded.command_tick.tolist(), rounded.command_latency_ns, strict=True):
        if tick in latency_ns:
            assert 0 <= new_ns - latency_ns[tick] < PERIOD_NS


@pytest.mark.parametrize("model", [m for m in Distribution if m is not Distribution.CONSTANT])
def test_the_distributions_are_those_of_the_plant(model: Distribution) -> None:
    cdf = latency_cdf(LatencySettings(model=model, mean_s=0.08, spread_s=0.03))
    for u in (0.01, 0.3, 0.9, 0.999):
        assert cdf(np.array([QUANTILES[model](u, 0.08, 0.03)]))[0] == pytest.approx(u, abs=1e-9)


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("latency.uplink.mean_s=0.01", "latency.uplink: must be left out"),
        ("sensor_period_ms=5", "sensor_period_ms: must be the control period"),
        ("latency.downlink.order='in_order'", "latency.downlink.order: must be newest_wins"),
        ("latency.downlink.correlation_time_s=1", "correlation_time_s: must be 0"),
        (
            "disturbance.steps=[{at_s=1,friction=0.5}]",
            "disturbance.steps: must not change friction",
        ),
        (
            "disturbance.model=tests.support.plugin_parts:PUSHES",
            "disturbance.steps: must not change friction",
        ),
        ("vehicle.model=tests.support.plugin_parts:SAME", "vehicle.model: must be left out"),
        (
            "latency.downlink.model=tests.support.plugin_parts:LIKE_UNIFORM",
            "latency.downlink.model: must be one of ours",
        ),
        ("latency.downlink.loss=1", "latency.downlink.loss: must be below 1"),
        ("latency.downlink={model='gamma',mean_s=3,spread_s=0.1}", "take a shorter latency"),
    ],
)
def test_what_is_no_jump_linear_loop_is_refused_in_one_line(override: str, message: str) -> None:
    with pytest.raises(SettingsError, match=message) as caught:
        expected_cost(plant_settings(override), PD)
    assert len(caught.value.mistakes) == 1
