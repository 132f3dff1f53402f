"""Delay from command to measurement, estimated from both, without an echo.

Two estimators look at different sensors and share the fit (``controller.delay_estimation.lag_fit``)
and the command:

    network disturbance   lateral error and curvature, as the CDOB's d̂_n sees them
    cross-correlation     yaw rate, which does not depend on the path

They estimate T of a measurement that arrives at t and shows the commands sent up to t - T:

    z(t) = g x(t - T) + c       T = lag + T_s/2 - mean age of the measurement in use at a tick

T is the downlink and uplink latency together. x and z are filtered by Tustin's rule from means over
the n control periods of a pair. That of the command, which is held over each period, is n T_s/2
late; that of the measurements at the ticks (n - 1) T_s/2. The term T_s/2 corrects the difference.
The measurement's age at a tick is not part of T. The vehicle's own lag is subtracted as far as its
mass is known. Any other lag, such as that of the steering actuator, counts as delay.

The loop is closed, so the command depends on the measurement. The yaw rate's noise does no harm,
because it never reaches the command. The lateral error's noise does, and would look like a delay
near zero. A share of about √(2 ω_h T_s) of it, which H leaves coloured, can correlate with old
commands. The standard deviation is widened by this share of the largest shift that the residual
could cause.

Both estimates have a standard deviation. The confidence is the probability that the error, assumed
normal, stays within the tolerance. The delay is observable where the confidence is high enough and
the two estimates do not contradict each other. No law uses the estimate, and compiled runs omit it.
"""

import math
from collections.abc import Sequence
from typing import Annotated, NamedTuple

from pydantic import Field

from ...runtime.node import NS_PER_MS, NS_PER_S
from ...runtime.settings import Settings
from ..filters.nominal_model import NominalVehicle
from ..filters.settings import NominalModelSettings, VehicleModelSettings
from ..law_interface import VehicleReading
from .comparison_filters import (
    ERROR_WASHOUT_RAD_S,
    DelayFilters,
    FilterStates,
    design_filters,
    filters_at_rest,
    filters_run,
    is_another_speed,
)
from .lag_fit import LEAD, LagFit, LagGrid

PAIR_S = 0.02
"""Time between the fitted pairs and between neighbouring lags: the cycle of the yaw rate."""
_PAIRS_PER_BLOCK = 5
"""Pairs filtered at once, which is faster; few enough that no tick takes long."""
_SPEED_M_S_MIN = 0.3
_SETTLING_S = 2.0
"""From a new design until pairs count again."""
_ERROR_SETTLING_S = 12.0 / ERROR_WASHOUT_RAD_S
"""From the start until pairs of the lateral error count."""
_AGE_S_MAX = 0.3
_GAIN_MIN, _GAIN_MAX = 0.8, 1.25
_CORRELATION_MIN = 0.5
_LAG_SHARE_YAW = 0.2
_LAG_SHARE_ERROR = 0.45
"""Relative standard deviation of the vehicle's lag, because its mass is not known."""
_CONTRADICTION = 3.0
"""How far the two estimates may differ, in standard deviations of their difference."""
_SKIPPED_MAX = 100
_AGE_IN_WINDOWS_MAX = 2.0
"""Mean age of the information beyond which it does not show the present delay."""


class DelayEstimationSettings(Settings):
    """[delay_estimation]: the delay estimated from command and response; no law uses it."""

    enabled: bool = True
    delay_s_max: Annotated[float, Field(ge=0.1, le=2.0)] = 1.0
    """Largest delay to search for."""
    window_s: Annotated[float, Field(ge=2.0, le=120.0)] = 10.0
    """Time constant of forgetting: how fast a delay that changes is followed."""
    tolerance_ms: Annotated[float, Field(ge=1.0, le=200.0)] = 10.0
    """The confidence is the probability of an error within this."""
    confidence_min: Annotated[float, Field(ge=0.5, le=0.999)] = 0.95
    """From this confidence on the delay counts as observable."""
    mass_over_nominal: Annotated[float, Field(ge=0.1, le=10.0)] = 1.65
    """Mass for computing the vehicle's own lag, relative to that of [nominal_model]. The default is
    the middle of 1600 to 5000 kg for a nominal 2000 kg."""


class DelayEstimationParams(NamedTuple):
    """Parameters of the estimation.

    ``vehicle``         its mass gives the vehicle's lag; its speed is not used
    ``delay_s_max``     largest delay to search for
    ``window_s``        time constant of forgetting
    ``tolerance_s``     the confidence is the probability of an error within this
    ``confidence_min``  from this confidence on the delay counts as observable
    """

    period_s: float
    vehicle: NominalVehicle
    delay_s_max: float
    window_s: float
    tolerance_s: float
    confidence_min: float


def delay_estimation_of(
    table: DelayEstimationSettings, model: NominalModelSettings | None, period_ns: int
) -> DelayEstimationParams | None:
    """Return the estimation's parameters, None if it is off or there is no nominal vehicle."""
    if not table.enabled or not isinstance(model, VehicleModelSettings):
        return None
    vehicle = model.vehicle
    return DelayEstimationParams(
        period_s=period_ns / NS_PER_S,
        vehicle=vehicle._replace(virtual_mass_kg=vehicle.virtual_mass_kg * table.mass_over_nominal),
        delay_s_max=table.delay_s_max,
        window_s=table.window_s,
        tolerance_s=table.tolerance_ms * NS_PER_MS / NS_PER_S,
        confidence_min=table.confidence_min,
    )


Observed = tuple[float, float, float, VehicleReading, float]
"""The controller's data at a tick.

    steer_rad        the command in effect up to now
    lateral_error_m  the newest measurement
    error_age_s      its age
    vehicle          the newest reading of the vehicle
    vehicle_age_s    its age
"""

_Pair = tuple[float, float, float, float, bool]
"""Means of a pair: command, yaw rate, lateral error, curvature; and whether it is fresh."""


class Estimate(NamedTuple):
    """A delay and its standard deviation [s]."""

    delay_s: float
    deviation_s: float


class DelayEstimate(NamedTuple):
    """The present state of knowledge.

    ``delay_s``        the newest observable delay, 0 before the first
    ``confidence``     probability that the present estimate is within the tolerance
    ``by_disturbance``, ``by_correlation``  result of each estimator, None if it has none
    """

    is_observable: bool
    delay_s: float
    confidence: float
    by_disturbance: Estimate | None
    by_correlation: Estimate | None


NOTHING_YET = DelayEstimate(False, 0.0, 0.0, None, None)


class DelayEstimator:
    """Collects commands and measurements, and evaluates them when a new estimate is due."""

    def __init__(self, params: DelayEstimationParams) -> None:
        self._params = params
        self._ticks_per_pair = max(1, round(PAIR_S / params.period_s))
        self._pair_s = self._ticks_per_pair * params.period_s
        lags = math.ceil(params.delay_s_max / self._pair_s) + LEAD + 2
        grid = LagGrid(self._pair_s, lags, params.window_s)
        half = grid.pairs_per_batch // 2  # so that they do not both take long at one tick
        self._by_disturbance, self._by_correlation = LagFit(grid), LagFit(grid, begin=half)
        self._keep = math.exp(-self._pair_s / params.window_s)
        self._weight = self._age_s = self._error_age_s = 0.0
        self._filters: DelayFilters | None = None
        self._states: FilterStates | None = None
        self._speed_m_s = 0.0
        self._waiting: list[Observed] = []
        """The control periods of a block, as far as they have passed."""
        self._pairs = self._unsettled_until = 0
        self._error_before_m = 0.0
        self.estimate = NOTHING_YET

    def on_tick(self, observed: Observed, skipped: int = 0) -> None:
        """Record a control period and the skipped periods before it."""
        waiting, per_block = self._waiting, self._ticks_per_pair * _PAIRS_PER_BLOCK
        if skipped:
            waiting += [observed] * min(skipped, _SKIPPED_MAX)
        waiting.append(observed)
        while len(waiting) >= per_block:
            self._take_block(waiting[:per_block])
            del waiting[:per_block]

    def _pairs_of(self, periods: Sequence[Observed]) -> list[_Pair]:
        """Return the means of the control periods of each pair."""
        count, pairs = self._ticks_per_pair, []
        for begin in range(0, len(periods), count):
            steer_rad = error_m = error_age_s = yaw_rate_rad_s = curvature_1_m = age_s = 0.0
            last = begin + count
            for steer, error, error_age, vehicle, age in periods[begin:last]:
                steer_rad += steer
                error_m += error
                error_age_s += error_age
                yaw_rate_rad_s += vehicle.yaw_rate_rad_s
                curvature_1_m += vehicle.preview_curvature_1_m
                age_s += age
            is_fresh = _is_fresh(periods[last - 1])
            if is_fresh:
                self._weight = self._keep * self._weight + 1.0
                self._age_s += (age_s / count - self._age_s) / self._weight
                self._error_age_s += (error_age_s / count - self._error_age_s) / self._weight
            means = steer_rad / count, yaw_rate_rad_s / count, error_m / count
            pairs.append((*means, curvature_1_m / count, is_fresh))
        return pairs

    def _take_block(self, periods: Sequence[Observed]) -> None:
        """Filter the pairs of a block, and pass them on to both fits."""
        pairs, newest = self._pairs_of(periods), periods[-1]
        speed_m_s = newest[3].speed_m_s
        if speed_m_s >= _SPEED_M_S_MIN and is_another_speed(speed_m_s, self._speed_m_s):
            self._design(speed_m_s, pairs[0])
        filters, states = self._filters, self._states
        if filters is None or states is None:
            return
        commands_rad, yaw_rates_rad_s, errors_m, curvatures_1_m, freshness = zip(
            *pairs, strict=True
        )
        before_m, self._error_before_m = (self._error_before_m, *errors_m[:-1]), errors_m[-1]
        # The lateral error at the time of the curvature, up to a pair ago.
        part = min(max((self._age_s - self._error_age_s) / self._pair_s, 0.0), 1.0)
        aligned_m = [
            error_m + part * (before_m - error_m)
            for before_m, error_m in zip(before_m, errors_m, strict=True)
        ]
        self._states, (x_a, z_a, x_b, z_b) = filters_run(
            filters, states, commands_rad, yaw_rates_rad_s, aligned_m, curvatures_1_m
        )
        self._pairs += _PAIRS_PER_BLOCK
        nothing = (False,) * _PAIRS_PER_BLOCK
        counts = freshness if self._pairs > self._unsettled_until else nothing
        is_settled = self._pairs * self._pair_s > _ERROR_SETTLING_S
        is_new = self._by_disturbance.push(x_a, z_a, counts if is_settled else nothing)
        is_new |= self._by_correlation.push(x_b, z_b, counts)
        if is_new:
            self._estimate(filters, _is_fresh(newest))

    def _design(self, speed_m_s: float, first: _Pair) -> None:
        """Design the filters for a speed; the first ones start at rest."""
        vehicle = self._params.vehicle._replace(speed_m_s=speed_m_s)
        filters = design_filters(vehicle, self._pair_s)
        if filters is not None and self._filters is None:
            _, yaw_rate_rad_s, self._error_before_m, _, _ = first
            self._states = filters_at_rest(filters, yaw_rate_rad_s, self._error_before_m)
        else:
            self._unsettled_until = self._pairs + round(_SETTLING_S / self._pair_s)
        self._filters, self._speed_m_s = filters, speed_m_s

    def _estimate(self, f: DelayFilters, is_fresh: bool) -> None:
        p = self._params
        share = math.sqrt(2.0 * ERROR_WASHOUT_RAD_S * p.period_s)
        by_disturbance = self._believed(self._by_disturbance, _LAG_SHARE_ERROR * f.lag_s, share)
        by_correlation = self._believed(self._by_correlation, _LAG_SHARE_YAW * f.lag_s, 0.0)
        both = combined(by_disturbance, by_correlation)
        confidence = 0.0
        if both is not None and is_fresh:
            confidence = math.erf(p.tolerance_s / (math.sqrt(2.0) * both.deviation_s))
        is_observable = confidence >= p.confidence_min
        delay_s = self.estimate.delay_s
        if both is not None and is_observable:
            delay_s = max(0.0, both.delay_s)
        self.estimate = DelayEstimate(
            is_observable, delay_s, confidence, by_disturbance, by_correlation
        )

    def _believed(self, fit: LagFit, lag_deviation_s: float, slack_share: float) -> Estimate | None:
        """Return the estimate of a peak that can be the response to the command."""
        p, peak = self._params, fit.peak
        if peak is None or not _GAIN_MIN <= peak.gain <= _GAIN_MAX:
            return None
        is_recent = peak.age_s <= _AGE_IN_WINDOWS_MAX * p.window_s
        is_usable = math.isfinite(peak.deviation_s) and is_recent
        if peak.correlation < _CORRELATION_MIN or not is_usable:
            return None
        deviation_s = math.hypot(peak.deviation_s, lag_deviation_s, slack_share * peak.slack_s)
        return Estimate(peak.lag_s + (0.5 * p.period_s - self._age_s), deviation_s)


def _is_fresh(observed: Observed) -> bool:
    """Whether the measurements are up to date and the vehicle moves."""
    _, _, error_age_s, vehicle, vehicle_age_s = observed
    is_young = error_age_s <= _AGE_S_MAX and vehicle_age_s <= _AGE_S_MAX
    return is_young and vehicle.speed_m_s >= _SPEED_M_S_MIN


def combined(one: Estimate | None, other: Estimate | None) -> Estimate | None:
    """Return the combined estimate, None where there is none or they contradict each other.

    They are weighted by their inverse variances. Their deviations do not average out, because
    errors in the vehicle's parameters affect both in the same way.
    """
    if one is None or other is None:
        return one or other
    spread_s = math.hypot(one.deviation_s, other.deviation_s)
    if abs(one.delay_s - other.delay_s) > _CONTRADICTION * spread_s:
        return None
    weight = (other.deviation_s / spread_s) ** 2
    return Estimate(
        other.delay_s + weight * (one.delay_s - other.delay_s),
        other.deviation_s + weight * (one.deviation_s - other.deviation_s),
    )
