"""The delay from command to measurement as the controller reports it: by echo and by estimate.

Both are the sum of downlink and uplink latency, measured by the controller's own clock:

    echo       mean of (arrival of a STEERING_STATUS - sending of the command that it names)
               - control period/2
    estimate   ``controller.delay_estimation.delay_estimator``, without the echo

Half a period is subtracted because a command is in effect for a whole period, and the echo may be
taken at any time in it. If the plant samples at the controller's rate, the echo is always taken at
the same point of the period, so that the result is wrong by half a period at most.

``controller.history.echo_delay`` measures a different delay with the same echoes, for laws that
predict: the downlink only, between counters. It does not contain the uplink or the difference of
the clocks.
"""

from collections.abc import Mapping
from typing import Any

from ...dbc.messages import DelayStatus, EchoState, EstimateState, limits
from ...runtime.node import NS_PER_S
from ..delay_estimation.delay_estimator import (
    DelayEstimationParams,
    DelayEstimator,
    delay_estimation_of,
)
from ..settings import ControllerSettings
from .newest_messages import Received

_LIMITS = limits(DelayStatus)


class EchoDelay:
    """Measures the delay by the echo of the command counter.

    ``averaging_ns``  time constant of the mean [ns]
    ``timeout_ns``    the delay is unknown after this time without an echo [ns]
    """

    def __init__(self, period_ns: int, averaging_ns: int, timeout_ns: int) -> None:
        self._half_period_ns = period_ns / 2
        self._averaging_ns = averaging_ns
        self._timeout_ns = timeout_ns
        self._echo_ns: int | None = None
        self._mean_ns = 0.0

    def on_echo(self, sent_ns: int, now_ns: int) -> None:
        """Take an echo of a command by when that was sent."""
        weight = 1.0
        if self._echo_ns is not None and now_ns - self._echo_ns <= self._timeout_ns:
            weight = min((now_ns - self._echo_ns) / self._averaging_ns, 1.0)
        self._mean_ns += weight * (now_ns - sent_ns - self._mean_ns)
        self._echo_ns = now_ns

    def delay_s(self, now_ns: int) -> float | None:
        """Return the delay [s], None if the last echo is older than the timeout."""
        if self._echo_ns is None or now_ns - self._echo_ns > self._timeout_ns:
            return None
        return max(0.0, (self._mean_ns - self._half_period_ns) / NS_PER_S)


class ReportedDelay:
    """Measures the delay in both ways: by ``echo`` and, unless ``params`` is None, by estimate."""

    def __init__(self, params: DelayEstimationParams | None, echo: EchoDelay) -> None:
        self._estimator = None if params is None else DelayEstimator(params)
        self.echo = echo
        self._period: int | None = None
        self._ticks = self._ticks_observable = 0
        self._first_observable_ticks: int | None = None

    def on_tick(self, now_ns: int, period: int, sent_steer_rad: float, received: Received) -> None:
        """Record a control period: the command in effect until now and the newest measurements."""
        error_ns, vehicle_ns = received.errors.arrival_ns, received.states.arrival_ns
        if self._estimator is None or error_ns is None or vehicle_ns is None:
            return
        skipped = 0 if self._period is None else period - self._period - 1
        self._period = period
        observed = (
            sent_steer_rad,
            received.lateral_error_m,
            (now_ns - error_ns) / NS_PER_S,
            received.vehicle,
            (now_ns - vehicle_ns) / NS_PER_S,
        )
        self._estimator.on_tick(observed, skipped)
        self._ticks += 1
        if self._estimator.estimate.is_observable:
            self._ticks_observable += 1
            if self._first_observable_ticks is None:
                self._first_observable_ticks = self._ticks

    def echo_s(self, now_ns: int) -> float | None:
        """Return the delay by the echo [s]; None while unknown."""
        return self.echo.delay_s(now_ns)

    @property
    def estimate_state(self) -> EstimateState:
        """Whether the delay can be estimated from command and response."""
        if self._estimator is None:
            return EstimateState.OFF
        if self._estimator.estimate.is_observable:
            return EstimateState.OBSERVABLE
        return EstimateState.NOT_OBSERVABLE

    def status(self, now_ns: int) -> DelayStatus:
        """Return the message; a delay is clamped to the range of its signal."""
        echo_s = self.echo_s(now_ns)
        estimated_s = confidence = 0.0
        if self._estimator is not None:
            estimated_s = self._estimator.estimate.delay_s
            confidence = self._estimator.estimate.confidence
        return DelayStatus(
            min(echo_s or 0.0, _LIMITS["echo_delay_s"].maximum),
            min(estimated_s, _LIMITS["estimated_delay_s"].maximum),
            EchoState.UNKNOWN if echo_s is None else EchoState.KNOWN,
            self.estimate_state,
            confidence,
        )

    def report(self, now_ns: int, period_s: float) -> Mapping[str, Any]:
        """Return the figures, ready for JSON; unknown ones are None.

        ``observable_share``    of the control periods since the vehicle's motion was first known
        ``first_observable_s``  time since then until the delay was first observable
        """
        estimator = self._estimator
        first = self._first_observable_ticks
        return {
            "echo_s": self.echo_s(now_ns),
            "estimate_state": self.estimate_state.name.lower(),
            "estimate_s": None
            if first is None or estimator is None
            else estimator.estimate.delay_s,
            "confidence": None if estimator is None else estimator.estimate.confidence,
            "observable_share": self._ticks_observable / self._ticks if self._ticks else 0.0,
            "first_observable_s": None if first is None else first * period_s,
        }


def reported_delay_of(settings: ControllerSettings) -> ReportedDelay:
    """Return the two measurements that the settings ask for; no law uses them."""
    averaging_ns = round(settings.link.delay_averaging_s * NS_PER_S)
    return ReportedDelay(
        delay_estimation_of(settings.delay_estimation, settings.nominal_model, settings.period_ns),
        EchoDelay(settings.period_ns, averaging_ns, settings.age_limits.steering_status_ns),
    )
