"""Delay from command to measurement, estimated from both, without an echo.

Two estimators look at different sensors and share the fit (``controller.lag_fit``) and the command:

    network disturbance   lateral error and curvature, as the CDOB's d̂_n sees them
    cross-correlation     yaw rate, which does not depend on the path

They estimate T of a measurement that arrives at t and shows the commands sent up to t - T:

    z(t) = g x(t - T) + c       T = lag + T_s/2 - mean age of the measurement in use at a tick

T is the downlink and uplink latency together. x is filtered by Tustin's rule from the command held
over the previous period, which makes it half a period late; the term T_s/2 corrects this. The
measurement's age at a tick is not part of T. The vehicle's own lag is subtracted as far as its
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
from typing import NamedTuple

from .delay_filters import ERROR_WASHOUT_RAD_S, DelayFilters, design_filters
from .lag_fit import LEAD, LagFit, LagGrid
from .law_interface import VehicleReading
from .nominal_model import NominalVehicle
from .sections import (
    SectionState,
    cascade_2_at_rest,
    cascade_3_at_rest,
    section_at_rest,
    sections_run,
)

PAIR_S = 0.02
"""Time between the fitted pairs and between neighbouring lags: the cycle of the yaw rate."""
_PAIRS_PER_PEAK = 5
_SPEED_M_S_MIN = 0.3
_SPEED_CHANGE = 0.05
"""Relative change of the speed at which the filters are designed anew."""
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


Seen = tuple[float, float, float, VehicleReading, float]
"""The controller's data at a tick.

    steer_rad        the command in effect up to now
    lateral_error_m  the newest measurement
    error_age_s      its age
    vehicle          the newest reading of the vehicle
    vehicle_age_s    its age
"""


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
        self._ticks_per_peak = self._ticks_to_peak = _PAIRS_PER_PEAK * self._ticks_per_pair
        step_s = self._ticks_per_pair * params.period_s
        lags = math.ceil(params.delay_s_max / step_s) + LEAD + 2
        grid = LagGrid(step_s, lags, params.window_s)
        self._by_disturbance, self._by_correlation = LagFit(grid), LagFit(grid)
        self._keep = math.exp(-params.period_s / params.window_s)
        self._weight = self._age_s = self._error_age_s = 0.0
        self._filters: DelayFilters | None = None
        self._speed_m_s = 0.0
        self._waiting: list[Seen] = []
        self._ticks = 0
        self._unsettled_until = 0
        self._offset_m = self._error_before_m = self._error_before_that_m = 0.0
        self.estimate = NOTHING_YET

    def on_tick(self, seen: Seen, skipped: int = 0) -> None:
        """Record a control period and the skipped periods before it."""
        if skipped:
            self._waiting += [seen] * min(skipped, _SKIPPED_MAX)
        self._waiting.append(seen)
        # The estimate does not change earlier.
        while len(self._waiting) >= self._ticks_to_peak:
            self._take(self._waiting[: self._ticks_to_peak])
            del self._waiting[: self._ticks_to_peak]
            self._ticks_to_peak = self._ticks_per_peak - self._ticks % self._ticks_per_peak

    def _take(self, block: Sequence[Seen]) -> None:
        """Process control periods up to the point where a new estimate may be due."""
        begin = 0
        for index, (_, _, _, vehicle, _) in enumerate(block):
            speed_m_s = vehicle.speed_m_s
            if speed_m_s == self._speed_m_s or speed_m_s < _SPEED_M_S_MIN:
                continue
            if abs(speed_m_s - self._speed_m_s) > _SPEED_CHANGE * self._speed_m_s:
                self._filter(block[begin:index])
                self._design(block[index])
                begin = index
        self._filter(block[begin:])
        if self._filters is not None and self._ticks % self._ticks_per_peak == 0:
            self._estimate(self._filters, _is_fresh(block[-1]))

    def _design(self, seen: Seen) -> None:
        """Design the filters for the present speed; the first ones start at rest."""
        p = self._params
        _, lateral_error_m, _, (speed_m_s, yaw_rate_rad_s, _, _), _ = seen
        filters = design_filters(p.vehicle._replace(speed_m_s=speed_m_s), p.period_s)
        if filters is not None and self._filters is None:
            self._x_yaw: Sequence[SectionState] = cascade_3_at_rest(filters.command_to_yaw, 0.0)[0]
            self._z_yaw: Sequence[SectionState] = cascade_2_at_rest(filters.yaw, yaw_rate_rad_s)[0]
            self._x_error: Sequence[SectionState] = cascade_3_at_rest(
                filters.command_to_error, 0.0
            )[0]
            at_rest: Sequence[SectionState] = (section_at_rest(filters.error, 0.0)[0],)
            self._z_error = self._z_curvature = self._z_low = at_rest
            self._offset_m = lateral_error_m
        else:
            self._unsettled_until = self._ticks + round(_SETTLING_S / p.period_s)
        self._filters, self._speed_m_s = filters, speed_m_s

    def _filter(self, block: Sequence[Seen]) -> None:
        """Filter the data of control periods at one speed, and pass on the pairs in it."""
        f = self._filters
        if f is None or not block:
            return
        commands_rad = [steer_rad for steer_rad, *_ in block]
        yaw_rates_rad_s = [yaw_rate_rad_s for _, _, _, (_, yaw_rate_rad_s, _, _), _ in block]
        curvatures_1_m = [curvature_1_m for _, _, _, (_, _, curvature_1_m, _), _ in block]
        errors_m, freshness = self._aligned(block)
        self._x_error, x_a = sections_run(f.command_to_error, self._x_error, commands_rad)
        self._z_error, swings_m = sections_run((f.error,), self._z_error, errors_m)
        self._z_curvature, drifts_m = sections_run(
            (f.curvature,), self._z_curvature, curvatures_1_m
        )
        moved_m = [swing_m + drift_m for swing_m, drift_m in zip(swings_m, drifts_m, strict=True)]
        self._z_low, z_a = sections_run((f.error_lowpass,), self._z_low, moved_m)
        self._x_yaw, x_b = sections_run(f.command_to_yaw, self._x_yaw, commands_rad)
        self._z_yaw, z_b = sections_run(f.yaw, self._z_yaw, yaw_rates_rad_s)
        to_pair = self._ticks_per_pair - self._ticks % self._ticks_per_pair - 1
        for index in range(to_pair, len(block), self._ticks_per_pair):
            ticks = self._ticks + index + 1
            counts = freshness[index] and ticks >= self._unsettled_until
            is_settled = ticks * self._params.period_s >= _ERROR_SETTLING_S
            self._by_disturbance.push(x_a[index], z_a[index], counts=counts and is_settled)
            self._by_correlation.push(x_b[index], z_b[index], counts=counts)
        self._ticks += len(block)

    def _aligned(self, block: Sequence[Seen]) -> tuple[list[float], list[bool]]:
        """Return the lateral errors, and which measurements are fresh.

        The lateral errors are those at the time of the curvature, up to two periods ago.
        """
        errors_m, freshness = [], []
        period_s, keep, offset_m = self._params.period_s, self._keep, self._offset_m
        weight, mean_age_s, mean_error_age_s = self._weight, self._age_s, self._error_age_s
        before_m, before_that_m = self._error_before_m, self._error_before_that_m
        for seen in block:
            _, error_m, error_age_s, _, vehicle_age_s = seen
            error_m -= offset_m
            periods = (mean_age_s - mean_error_age_s) / period_s
            if periods <= 0.0:
                errors_m.append(error_m)
            elif periods <= 1.0:
                errors_m.append(error_m + periods * (before_m - error_m))
            else:
                part = periods - 1.0 if periods < 2.0 else 1.0
                errors_m.append(before_m + part * (before_that_m - before_m))
            before_m, before_that_m = error_m, before_m
            is_fresh = _is_fresh(seen)
            freshness.append(is_fresh)
            if is_fresh:
                weight = keep * weight + 1.0
                mean_age_s += (vehicle_age_s - mean_age_s) / weight
                mean_error_age_s += (error_age_s - mean_error_age_s) / weight
        self._weight, self._age_s, self._error_age_s = weight, mean_age_s, mean_error_age_s
        self._error_before_m, self._error_before_that_m = before_m, before_that_m
        return errors_m, freshness

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
        p, peak = self._params, fit.peak()
        if peak is None or not _GAIN_MIN <= peak.gain <= _GAIN_MAX:
            return None
        is_recent = peak.age_s <= _AGE_IN_WINDOWS_MAX * p.window_s
        is_usable = math.isfinite(peak.deviation_s) and is_recent
        if peak.correlation < _CORRELATION_MIN or not is_usable:
            return None
        deviation_s = math.hypot(peak.deviation_s, lag_deviation_s, slack_share * peak.slack_s)
        return Estimate(peak.lag_s + (0.5 * p.period_s - self._age_s), deviation_s)


def _is_fresh(seen: Seen) -> bool:
    """Whether the measurements are up to date and the vehicle moves."""
    _, _, error_age_s, (speed_m_s, _, _, _), vehicle_age_s = seen
    is_young = error_age_s <= _AGE_S_MAX and vehicle_age_s <= _AGE_S_MAX
    return is_young and speed_m_s >= _SPEED_M_S_MIN


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
