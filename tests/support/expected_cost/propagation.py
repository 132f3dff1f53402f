"""Expected quadratic cost under random latency, computed without runs (as Jitterbug does).

    J = (y[1]² + ... + y[N]²)/N        of one run: the mean square of its lateral error

The age i of the newest command that has arrived is a Markov chain (``controller.analysis.jitter``),
and given i the loop is linear. With x that has a constant 1 as its last element

    x⁺ = A_i[k] x + v n[k]             n: white noise of the sensor, standard deviation σ
    m_i = E[x 1{i}]                    m_j⁺ = Σ_i P(i → j) A_i[k] m_i
    X_i = E[x xᵀ 1{i}]                 X_j⁺ = Σ_i P(i → j) (A_i[k] X_i A_i[k]ᵀ + p_i σ² v vᵀ)

are exact recursions (Lincoln and Cervin 2002), whatever the path: what it adds in step k is the
last column of A_i[k]. They give E[J] exactly. With ȳ = E y and e = y - ȳ, J is random over seeds by

    J - E[J] = (2/N) Σ ȳ e + (1/N) Σ (e² - E[e²])

The variance of the first sum is exact, the sum being one more state of the linear loop. That of the
second needs fourth moments, too many to be propagated; with those of a Gaussian process it is

    (2/N²) Σ_k Σ_l C_kl²               C_kl = E[e_k e_l]

and the covariance of the two sums, 0. C_kl is exact for LAGS_FROM instants k spread over the run.

Latencies on the grid of steps are treated exactly; ``Rounding`` defines how others are rounded.
"""

import math
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from steer_by_wire.controller.analysis import arrivals
from steer_by_wire.controller.analysis.jitter import newest_arrivals
from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.plant_emulator.network.latency_distributions import RESOLUTION_S, Distribution
from steer_by_wire.plant_emulator.network.settings import LatencySettings
from steer_by_wire.plant_emulator.settings import PlantSettings
from steer_by_wire.runtime.array_types import FloatArray
from steer_by_wire.runtime.settings import SettingsError
from tests.support.expected_cost.linear_loop import (
    LATERAL_ERROR,
    LinearLoop,
    Recursion,
    linear_loop,
    move_first,
    move_second,
)

LAGS_FROM = 24
NUMBERS_MAX = 250_000
"""Limit for all second moments together: about a millisecond a period."""


class Rounding(StrEnum):
    """How a latency is rounded to whole steps."""

    UP = "up"
    """As ``on_grid`` rounds the latencies of a run, so that the two can be compared."""
    NEAREST = "nearest"
    """Keeps the mean; an approximation that gets better with shorter steps."""


class ExpectedCost(NamedTuple):
    """Cost of a run over all seeds; the arrays have shape (periods,), from the first sample on.

    ``mean_square_m2``  E[J]
    ``variance_m4``     of J over seeds
    ``error_mean_m``, ``error_deviation_m``   of the lateral error over seeds, at each sample
    """

    mean_square_m2: float
    variance_m4: float
    time_s: FloatArray
    error_mean_m: FloatArray
    error_deviation_m: FloatArray


def expected_cost(
    plant: PlantSettings,
    controller: ControllerSettings,
    steps_per_period: int = 1,
    rounding: Rounding = Rounding.UP,
) -> ExpectedCost:
    """Return the expected cost of a run of these settings; their seed does not matter.

    Raises SettingsError for settings whose loop is not linear with independent latencies, or with
    too many commands on their way.
    """
    loop = linear_loop(plant, controller, steps_per_period)
    step_s = loop.period_s / steps_per_period
    when = _arrivals(plant.latency.downlink, step_s, steps_per_period, rounding)
    return _Moments(loop, when).cost()


def latency_cdf(line: LatencySettings) -> arrivals.LatencyCdf:
    """Return the distribution of the latencies that a line draws."""
    from scipy.special import ndtr

    mean_s, spread_s = line.mean_s, line.spread_s
    if line.model is Distribution.CONSTANT or min(mean_s, spread_s) < RESOLUTION_S:
        # Settings are whole ns: a latency on the grid must not leave it by rounding.
        return lambda t: np.where(t >= mean_s - 0.5 * RESOLUTION_S, 1.0, 0.0)
    if line.model is Distribution.GAMMA:
        return arrivals.gamma_cdf(mean_s, spread_s)
    if line.model is Distribution.UNIFORM:
        return arrivals.uniform_cdf(mean_s, spread_s)
    if line.model is Distribution.NORMAL:
        return lambda t: np.asarray(ndtr((t - mean_s) / spread_s))
    sigma = math.sqrt(math.log(1.0 + (spread_s / mean_s) ** 2))
    mu = math.log(mean_s) - 0.5 * sigma**2
    return lambda t: np.asarray(ndtr((np.log(np.maximum(t, 1e-300)) - mu) / sigma))


def _arrivals(
    line: LatencySettings, step_s: float, steps_per_period: int, rounding: Rounding
) -> arrivals.Arrivals:
    """Return when commands arrive, in whole steps, as far as the tail matters."""
    cdf, shift = latency_cdf(line), 0.5 if rounding is Rounding.NEAREST else 0.0
    enough = 1.0 - 1e-3 * arrivals.AGE_PROBABILITY_MIN
    for exponent in range(6, 17):
        values = cdf((np.arange(1 << exponent, dtype=np.float64) + shift) * step_s)
        if values[-1] >= enough:
            break
    needed = int(np.searchsorted(values, enough)) + 1
    return arrivals.Arrivals(values[:needed], line.loss, steps_per_period)


class _Moments:
    """The recursions over a run.

    A mode is the age in periods of the command held, from the youngest that ever arrives on. Before
    the first command arrives the oldest is held, of value 0; all real ones are younger than it.
    """

    def __init__(self, loop: LinearLoop, when: arrivals.Arrivals) -> None:
        if when.loss >= 1.0:
            raise SettingsError("latency.downlink.loss: must be below 1, or no command arrives")
        hazards, oldest = arrivals.hazards_by_age(when)
        youngest = int(np.argmax(hazards > 0.0)) // when.steps_per_period
        plant_end = len(loop.hold)
        law_end = plant_end + len(loop.law.b)
        self._loop = loop
        self._modes = oldest + 1 - youngest
        self._order = law_end + oldest + 1 + 2
        if self._modes * self._order**2 > NUMBERS_MAX:
            raise SettingsError(
                f"latency.downlink: {self._modes} ages of the command held times {self._order}²"
                f" moments are more than {NUMBERS_MAX}: take a shorter latency or a smaller spread"
            )
        law, ages = loop.law, np.arange(youngest, oldest + 1) * when.steps_per_period
        choices = [newest_arrivals(hazards[ages + s]) for s in range(when.steps_per_period)]
        self._recursion = Recursion(
            decision=np.vstack([np.append(law.b, law.d), np.column_stack([law.a.T, law.c])]),
            transition=np.ascontiguousarray(loop.transition.T),
            hold=np.ascontiguousarray(loop.hold),
            chosen=np.array([chosen for chosen, _ in choices]),
            kept=np.array([kept for _, kept in choices]),
            held=law_end + youngest,
            plant_end=plant_end,
            law_end=law_end,
        )
        self._driven = loop.driven.reshape(loop.periods, loop.steps_per_period, plant_end)
        rest = loop.law_at_rest
        self._noise, self._first_noise = np.zeros((2, self._order))
        self._noise[plant_end : law_end + 1] = loop.noise_m * np.append(law.b, law.d)
        self._first_noise[plant_end : law_end + 1] = loop.noise_m * np.append(
            law.a @ rest + law.b, law.c @ rest + law.d
        )

    def cost(self) -> ExpectedCost:
        """Compute the means over the run, then the second moments."""
        periods, y, total, one = self._loop.periods, LATERAL_ERROR, self._order - 2, self._order - 1
        mean = np.zeros((self._modes, self._order, 1))
        mean[-1, one] = 1.0
        error_mean_m = np.empty(periods)
        for period, driven in enumerate(self._driven):
            move_first(self._recursion, mean, driven)
            error_mean_m[period] = mean[:, y, 0].sum()
        second = np.zeros((self._modes, self._order, self._order))
        second[-1, one, one] = 1.0
        count = min(LAGS_FROM, periods)
        instants = ((np.arange(count) + 0.5) * periods / count).astype(np.int64).tolist()
        lagged = np.zeros((self._modes, self._order, count))
        started = 0
        mean_square_m2 = np.empty(periods)
        squares = 0.0  # Σ_l C_kl² over the instants k; each pair counts from its earlier end, twice
        for period, mean_m in enumerate(error_mean_m.tolist()):
            noise = self._noise if period else self._first_noise
            move_second(self._recursion, second, self._driven[period], noise)
            second[:, total] += mean_m * second[:, y]
            second[:, :, total] += mean_m * second[:, :, y]
            mean_square_m2[period] = second[:, y, y].sum()
            move_first(self._recursion, lagged, self._driven[period])
            squares += 2.0 * float(np.sum(lagged[:, y].sum(axis=0) ** 2))
            if started < count and instants[started] == period:
                lagged[:, :, started] = second[:, :, y] - mean_m * second[:, :, one]
                squares += float(lagged[:, y, started].sum() ** 2)
                started += 1
        linear = float(second[:, total, total].sum()) - float(second[:, total, one].sum()) ** 2
        quadratic = 2.0 * squares * periods / count  # each instant stands for as many
        return ExpectedCost(
            mean_square_m2=float(mean_square_m2.mean()),
            variance_m4=(4.0 * max(linear, 0.0) + quadratic) / periods**2,
            time_s=np.asarray(self._loop.period_s * np.arange(1, periods + 1), dtype=np.float64),
            error_mean_m=error_mean_m,
            error_deviation_m=np.sqrt(np.maximum(mean_square_m2 - error_mean_m**2, 0.0)),
        )
