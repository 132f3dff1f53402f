"""Law ``pid`` against its textbook form, an offset that it takes out, and a limit that holds it."""

import numpy as np
import pytest

from steer_by_wire import simulate
from steer_by_wire.controller.filters.settings import PdSettings
from steer_by_wire.controller.law_interface import NO_HISTORY, NO_LOOP_DELAY, LawInput
from steer_by_wire.controller.laws.law_from_settings import LawDesign, design_law
from steer_by_wire.controller.laws.pid import PidSettings
from steer_by_wire.controller.laws.settings import LawSettings
from steer_by_wire.controller.settings import controller_preset

PERIOD_S = 0.01
K_P, K_D, N_RAD_S, K_I = 1.2, 0.16, 12.0, 2.0


def pid() -> LawDesign:
    pd = PdSettings(
        proportional_gain_rad_m=K_P, derivative_gain_rad_s_m=K_D, derivative_filter_rad_s=N_RAD_S
    )
    tables = {"law": "pid", "pd": pd, "pid": PidSettings(integral_gain_rad_m_s=K_I)}
    return design_law(LawSettings.model_validate(tables))


def test_without_limits_it_is_the_textbook_sum_of_three_terms() -> None:
    errors_m = np.random.default_rng(3).standard_normal(300) * 0.1
    integral = -K_I * PERIOD_S * np.cumsum(errors_m)
    # The filtered derivative by the trapezoidal rule, from the differential equation.
    derivative, filtered, before_m = [], 0.0, 0.0
    a = N_RAD_S * PERIOD_S / 2.0
    for error_m in errors_m:
        filtered = ((1.0 - a) * filtered + N_RAD_S * (error_m - before_m)) / (1.0 + a)
        derivative.append(filtered)
        before_m = float(error_m)
    wanted = -K_P * errors_m - K_D * np.array(derivative) + integral
    design, sent_rad, answers = pid(), 0.0, []
    state = design.initial_state(0.0)
    for error_m in errors_m.tolist():
        state, output = design.step(design.params, state, LawInput(error_m, sent_rad))
        sent_rad = output.steer_rad
        answers.append(sent_rad)
    assert answers == pytest.approx(wanted, abs=1e-12)


def test_behind_a_limit_the_demand_settles_where_the_tracking_balances() -> None:
    """So the integral does not wind up, however long an error keeps the command at its limit."""
    design, error_m, limit_rad = pid(), 0.5, 0.3
    state, demand_rad = design.initial_state(error_m), 0.0
    for _ in range(3000):
        sent_rad = max(demand_rad, -limit_rad)
        state, output = design.step(design.params, state, LawInput(error_m, sent_rad))
        demand_rad = output.steer_rad
    tracking_time_s = K_P / K_I + K_D / K_P
    assert demand_rad == pytest.approx(-limit_rad - K_I * tracking_time_s * error_m, rel=1e-6)


def test_noise_that_meets_the_rate_limit_does_not_empty_the_integral() -> None:
    """20 mm of noise on a sharp derivative is at the rate limit at nearly every tick."""
    sharp = {
        "proportional_gain_rad_m": 0.325,
        "derivative_gain_rad_s_m": 0.99,
        "derivative_filter_rad_s": 2.6,
    }
    settings = controller_preset("practical_pid", ("followed_point=preview",)).model_copy(
        update={"pd": PdSettings(**sharp), "pid": PidSettings(integral_gain_rad_m_s=13.4)}
    )
    run = simulate(
        controller=settings,
        duration_s=40.0,
        seed=3,
        overrides={
            "plant.latency.downlink.mean_s": 0.08,
            "plant.sensor_noise.lateral_error_m": 0.02,
        },
    )
    assert np.std(run.plant.lateral_error_m[500:]) < 0.02


def test_it_reads_the_heading_error_only_where_that_has_a_gain() -> None:
    rings = NO_HISTORY._replace(heading_error_rad=(0.0, 0.03), sample_mask=1)
    observed = LawInput(0.1, 0.0, loop_delay=NO_LOOP_DELAY._replace(error_sample=5), history=rings)
    steers_rad = []
    for gain in (None, 2.0):
        table = {"integral_gain_rad_m_s": K_I, "heading_gain_rad_rad": gain}
        design = design_law(
            controller_preset("practical_pid", ("followed_point=preview",)).model_copy(
                update={"pid": PidSettings(**table)}
            )
        )
        assert design.looks_back is (gain is not None)
        _, output = design.step(design.params, design.initial_state(0.1), observed)
        steers_rad.append(output.steer_rad)
    assert steers_rad[1] - steers_rad[0] == pytest.approx(-2.0 * 0.03)


def test_its_gain_must_be_above_zero() -> None:
    with pytest.raises(ValueError, match="integral_gain_rad_m_s"):
        PidSettings(integral_gain_rad_m_s=0.0)
