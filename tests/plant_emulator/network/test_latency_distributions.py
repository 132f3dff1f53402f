"""Latency distributions: their shape, their moments, and the process that correlates them."""

import math
from itertools import product
from statistics import NormalDist

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.dbc.messages import LatencyModel
from steer_by_wire.plant_emulator.network.latency_distributions import (
    QUANTILES,
    RESOLUTION_S,
    Distribution,
)
from steer_by_wire.plant_emulator.network.latency_draw import correlated_score, uniform_of_score

U_MIN, U_MAX = 2.0**-54, 1.0 - 2.0**-53
MEAN_S, SPREAD_S = 0.080, 0.030
GRID = [(k + 0.5) / 50_000 for k in range(50_000)]
SPREADING = [model for model in Distribution if model is not Distribution.CONSTANT]

every_model = pytest.mark.parametrize("model", Distribution)
normal_score = NormalDist().inv_cdf
uniforms = st.floats(U_MIN, U_MAX)
means_s = st.floats(0.0, 10.0)
spreads_s = st.floats(0.0, 10.0)


def latencies_s(model: Distribution, mean_s: float, spread_s: float) -> np.ndarray:
    return np.array([QUANTILES[model](u, mean_s, spread_s) for u in GRID])


def test_the_distributions_are_those_of_the_wire() -> None:
    assert [model.name for model in Distribution] == [model.name for model in LatencyModel]
    assert set(QUANTILES) == set(Distribution)


@pytest.mark.parametrize(
    ("model", "at_the_0_9_quantile_s"),
    [
        (Distribution.CONSTANT, 0.080),
        (Distribution.UNIFORM, 0.080 + 0.8 * 3**0.5 * 0.030),
        (Distribution.NORMAL, 0.080 + 0.030 * 1.2815515655446004),
        (
            Distribution.LOGNORMAL,
            0.080 / math.sqrt(1.140625) * math.exp(math.sqrt(math.log(1.140625)) * 1.28155156554),
        ),
    ],
)
def test_a_quantile_by_hand(model: Distribution, at_the_0_9_quantile_s: float) -> None:
    assert QUANTILES[model](0.9, MEAN_S, SPREAD_S) == pytest.approx(at_the_0_9_quantile_s, rel=1e-9)


@pytest.mark.parametrize(
    ("model", "mean_s", "spread_s"),
    [
        *(
            (model, 0.3, 0.02) for model in SPREADING
        ),  # fifteen deviations from zero none is clipped
        (Distribution.LOGNORMAL, MEAN_S, MEAN_S),
        (Distribution.GAMMA, MEAN_S, MEAN_S),
    ],
)
def test_mean_and_standard_deviation_are_the_settings(
    model: Distribution, mean_s: float, spread_s: float
) -> None:
    drawn_s = latencies_s(model, mean_s, spread_s)
    assert drawn_s.min() > 0.0
    assert drawn_s.mean() == pytest.approx(mean_s, rel=1e-4)
    assert drawn_s.std() == pytest.approx(spread_s, rel=1e-2)


def test_clipping_the_normal_distribution_moves_its_mean_as_the_docstring_says() -> None:
    assert latencies_s(Distribution.NORMAL, 0.080, 0.030).mean() - 0.080 == pytest.approx(
        0.04e-3, abs=0.005e-3
    )


@pytest.mark.parametrize("model", [Distribution.UNIFORM, Distribution.NORMAL])
def test_what_would_be_negative_is_zero(model: Distribution) -> None:
    drawn_s = latencies_s(model, 0.01, 0.03)
    assert drawn_s.min() == 0.0
    assert (drawn_s == 0.0).mean() == pytest.approx(
        {Distribution.UNIFORM: 0.5 - 0.01 / (2 * 3**0.5 * 0.03), Distribution.NORMAL: 0.36944}[
            model
        ],
        abs=1e-4,
    )


@every_model
@given(means_s, spreads_s, uniforms, uniforms)
def test_a_larger_uniform_is_a_later_frame_and_no_latency_is_negative_or_endless(
    model: Distribution, mean_s: float, spread_s: float, one: float, other: float
) -> None:
    quantile = QUANTILES[model]
    early_s = quantile(min(one, other), mean_s, spread_s)
    late_s = quantile(max(one, other), mean_s, spread_s)
    # Where gamma's shape is extreme, scipy's inverse is monotone but for its last digits.
    assert 0.0 <= early_s <= late_s * (1.0 + 1e-9) + RESOLUTION_S
    assert late_s < math.inf


@every_model
def test_the_ends_of_the_settings_give_finite_latencies(model: Distribution) -> None:
    small_and_large_s = (0.0, 5e-324, 1e-200, 1e-9, 10.0)
    for drawn in product((U_MIN, 0.5, U_MAX), small_and_large_s, small_and_large_s):
        assert 0.0 <= QUANTILES[model](*drawn) < math.inf, drawn


@every_model
@given(uniforms, means_s)
def test_without_spread_every_latency_is_the_mean(
    model: Distribution, u: float, mean_s: float
) -> None:
    assert QUANTILES[model](u, mean_s, 0.0) == mean_s


@every_model
@given(uniforms, st.floats(0.01, 1.0), st.floats(0.0, 1.0))
def test_a_larger_mean_moves_every_frame_later(
    model: Distribution, u: float, mean_s: float, more_s: float
) -> None:
    spread_s = 0.5 * mean_s
    share = (mean_s + more_s) / mean_s
    quantile = QUANTILES[model]
    assert quantile(u, mean_s * share, spread_s * share) >= quantile(u, mean_s, spread_s)


# AR(1)


def correlated_scores(count: int, elapsed_s: float, correlation_time_s: float) -> np.ndarray:
    uniform = np.random.Generator(np.random.PCG64(7)).random(count).tolist()
    score = normal_score(uniform[0])
    scores = [score]
    for u in uniform[1:]:
        score = correlated_score(score, u, elapsed_s, correlation_time_s)
        scores.append(score)
    return np.array(scores)


def test_the_process_stays_standard_normal_and_is_correlated_as_asked() -> None:
    z = correlated_scores(200_000, 0.01, 0.05)
    assert z.mean() == pytest.approx(0.0, abs=0.03)
    assert z.std() == pytest.approx(1.0, abs=0.02)
    assert (abs(z) < 1.0).mean() == pytest.approx(0.6827, abs=0.01)
    for lag in (1, 5, 10):
        assert np.corrcoef(z[:-lag], z[lag:])[0, 1] == pytest.approx(
            math.exp(-lag * 0.01 / 0.05), abs=0.03
        )


def test_a_step_by_hand() -> None:
    phi = math.exp(-2.0)
    assert correlated_score(1.5, 0.9, 0.02, 0.01) == pytest.approx(
        phi * 1.5 + math.sqrt(1.0 - phi**2) * 1.2815515655446004, rel=1e-12
    )


@given(st.floats(1e-6, 1.0 - 1e-6))
def test_score_and_uniform_are_each_others_inverse(u: float) -> None:
    assert uniform_of_score(normal_score(u)) == pytest.approx(u, rel=1e-9)
