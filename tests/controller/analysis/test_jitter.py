"""Mean-square stability under jitter: by hand, without jitter, and against simulated runs."""

import math

import numpy as np
import pytest

from steer_by_wire.closed_loop.compiled.engine import run_compiled
from steer_by_wire.controller.analysis.jitter import (
    Arrivals,
    JitterTooLargeError,
    MomentRecursion,
    arrivals,
    constant_cdf,
    gamma_cdf,
    stable_spreads,
)
from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.plant_emulator.network.latency_distributions import gamma_quantile
from steer_by_wire.plant_emulator.settings import plant_preset
from steer_by_wire.runtime.array_types import FloatArray
from tests.support.loops.wide_stretches import (
    PD,
    PD_CDOB,
    PD_DDOB,
    PD_DOB,
    PLANT,
    loop_of,
    proportional_loop,
)
from tests.support.suite.combinations import combined, sampled

MS_NS = 1_000_000
PERIOD_S = 0.01


def decay_1_s(chosen: ControllerSettings, mean_ms: int, spread_ms: int, loss: float = 0.0) -> float:
    cdf = gamma_cdf(mean_ms / 1e3, spread_ms / 1e3)
    return MomentRecursion(loop_of(chosen), arrivals(cdf, 10 * MS_NS, loss)).decay_1_s()


# By hand


@pytest.mark.parametrize(("gain", "loss"), combined([0.1, 0.5, 1.2], [0.05, 0.3]))
def test_an_integrator_with_lost_commands_has_the_moments_written_down_by_hand(
    gain: float, loss: float
) -> None:
    """With y and the command h held before, in the order E[y²], E[yh], E[h²]:

    after arrival  (a, -(1-p) g a + p b, (1-p) g² a + p c), then y becomes y + h.
    """
    arrival = np.array(
        [[1.0, 0.0, 0.0], [-(1 - loss) * gain, loss, 0.0], [(1 - loss) * gain**2, 0.0, loss]]
    )
    motion = np.array([[1.0, 2.0, 1.0], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]])
    radius = max(abs(np.linalg.eigvals(motion @ arrival)))
    found = MomentRecursion(proportional_loop(gain), Arrivals(np.array([1.0]), loss)).decay_1_s()
    assert found == pytest.approx(-0.5 * math.log(radius) / PERIOD_S, rel=1e-3)


def test_a_command_that_comes_now_or_next_time_has_the_moments_written_down_by_hand() -> None:
    """With y and the last command u' = -g y': half of the commands act at once, half a tick late.

    Of those that are late only the newest counts, so that u' is held with probability 1/2.
    """
    gain, at_once = 0.9, 0.5
    held = [np.array([[1.0 - gain, 0.0], [-gain, 0.0]]), np.array([[1.0, 1.0], [-gain, 0.0]])]
    lifted = at_once * np.kron(held[0], held[0]) + (1.0 - at_once) * np.kron(held[1], held[1])
    radius = max(abs(np.linalg.eigvals(lifted)))
    when = Arrivals(np.array([at_once, 1.0]))
    found = MomentRecursion(proportional_loop(gain), when).decay_1_s()
    assert found == pytest.approx(-0.5 * math.log(radius) / PERIOD_S, rel=1e-3)


def test_a_loop_that_is_at_rest_after_one_period_decays_faster_than_any_rate() -> None:
    when = Arrivals(np.array([1.0]))
    assert MomentRecursion(proportional_loop(1.0), when).decay_1_s() > 1e3


def test_nothing_that_arrives_is_an_error_and_so_is_too_much() -> None:
    with pytest.raises(ValueError, match="no command ever arrives"):
        MomentRecursion(proportional_loop(0.1), Arrivals(np.array([0.0])))
    with pytest.raises(JitterTooLargeError, match="take a lower rate"):
        MomentRecursion(proportional_loop(0.1), arrivals(gamma_cdf(0.9, 0.4), 10 * MS_NS))


# Without jitter


@pytest.mark.parametrize(
    ("chosen", "delay_ms"), combined([PD, PD_DOB, PD_CDOB, PD_DDOB], [0, 80, 160])
)
def test_a_latency_that_does_not_vary_has_the_rate_of_the_poles(
    chosen: ControllerSettings, delay_ms: int
) -> None:
    loop = loop_of(chosen)
    when = arrivals(constant_cdf(delay_ms / 1e3), loop.period_ns)
    # Equal real modes of the observers, of plant zero and filter pole, are known to 2 %.
    expected_1_s = loop.decay_1_s(delay_ms * MS_NS)
    assert MomentRecursion(loop, when).decay_1_s() == pytest.approx(expected_1_s, rel=2e-2)
    assert (MomentRecursion(loop, when).decay_1_s() > 0.0) == loop.is_stable(delay_ms * MS_NS)


# Distributions


@pytest.mark.parametrize(("mean_s", "spread_s"), [(0.08, 0.03), (0.16, 0.05), (0.02, 0.02)])
def test_the_distribution_is_that_of_the_plant(mean_s: float, spread_s: float) -> None:
    for u in (0.001, 0.2, 0.5, 0.9, 0.999):
        cdf = gamma_cdf(mean_s, spread_s)(np.array([gamma_quantile(u, mean_s, spread_s)]))
        assert cdf[0] == pytest.approx(u, abs=1e-9)


# Against simulation


def steer_envelope_rad(chosen: ControllerSettings, mean_ms: int, spread_ms: int) -> FloatArray:
    """Return the largest wheel angle of each second of 40 [rad], after a push from the side."""
    downlink = f"{{model='gamma',mean_s={mean_ms / 1e3},spread_s={spread_ms / 1e3},loss=0.01}}"
    plant = plant_preset(
        "paper_nominal",
        [
            *PLANT,
            "path={kind='straight'}",
            "duration_s=40",
            f"latency.downlink={downlink}",
            "disturbance.steps=[{at_s=1,side_force_n=20000},{at_s=1.5,side_force_n=0}]",
        ],
    )
    angle_rad = run_compiled(plant, chosen).wheel_angle_rad
    return np.asarray(np.abs(angle_rad[:4000]).reshape(40, 100).max(axis=1))


@pytest.mark.parametrize(
    ("chosen", "mean_ms", "spread_ms", "stable"),
    sampled(
        [
            (PD, 80, 30, True),
            (PD, 80, 10, False),
            (PD_CDOB, 160, 50, True),
            (PD_DDOB, 80, 15, False),
        ],
        [
            *((PD, 80, 30, True), (PD, 80, 10, False), (PD, 160, 50, False)),
            *((PD_DOB, 250, 70, True), (PD_DOB, 250, 20, False)),
            *((PD_CDOB, 80, 50, True), (PD_CDOB, 80, 10, False), (PD_CDOB, 160, 50, True)),
            *((PD_DDOB, 160, 50, True), (PD_DDOB, 80, 15, False)),
        ],
    ),
)
def test_runs_in_virtual_time_bear_the_jitter_that_the_analysis_says_they_do(
    chosen: ControllerSettings, mean_ms: int, spread_ms: int, *, stable: bool
) -> None:
    rate_1_s = decay_1_s(chosen, mean_ms, spread_ms, loss=0.01)
    envelope_rad = steer_envelope_rad(chosen, mean_ms, spread_ms)
    assert (rate_1_s > 0.1) == stable
    assert (rate_1_s < -0.1) != stable
    assert (envelope_rad[-10:].max() < 1e-2) == stable
    assert (envelope_rad[-10:].max() > 0.5) != stable


# The largest spread


def test_the_spreads_tolerated_end_where_the_mean_square_begins_to_grow() -> None:
    loop = loop_of(PD)
    (spreads,) = stable_spreads(loop, 80 * MS_NS)
    assert spreads.first_ns > 0  # 80 ms of constant latency are too much
    assert spreads.last_ns == 80 * MS_NS
    before_ms, after_ms = spreads.first_ns / MS_NS - 1.0, spreads.first_ns / MS_NS
    for spread_ms, stable in ((before_ms, False), (after_ms, True)):
        when = arrivals(gamma_cdf(0.08, spread_ms / 1e3), loop.period_ns)
        assert (MomentRecursion(loop, when).decay_1_s() > 0.0) == stable
