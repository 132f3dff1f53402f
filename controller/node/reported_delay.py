"""The delay from command to measurement by echo, as the controller reports it.

It is the sum of downlink and uplink latency, measured by the controller's own clock:

    mean of (arrival of a STEERING_STATUS - sending of the command that it names) - control period/2

Half a period is subtracted because a command is in effect for a whole period, and the echo may be
taken at any time in it. If the plant samples at the controller's rate, the echo is always taken at
the same point of the period, so that the result is wrong by half a period at most.

``controller.history.echo_delay`` measures a different delay with the same echoes, for laws that
predict: the downlink only, between counters. It does not contain the uplink or the difference of
the clocks.
"""

from ...dbc.messages import DelayStatus, EchoState, limits
from ...runtime.node import NS_PER_S
from ..settings import ControllerSettings

_DELAY_S_MAX = limits(DelayStatus)["echo_delay_s"].maximum


class ReportedDelay:
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

    def echo_s(self, now_ns: int) -> float | None:
        """Return the delay [s], None if the last echo is older than the timeout."""
        if self._echo_ns is None or now_ns - self._echo_ns > self._timeout_ns:
            return None
        return max(0.0, (self._mean_ns - self._half_period_ns) / NS_PER_S)

    def status(self, now_ns: int) -> DelayStatus:
        """Return the message; the delay is clamped to the range of its signal."""
        echo_s = self.echo_s(now_ns)
        if echo_s is None:
            return DelayStatus(0.0, EchoState.UNKNOWN)
        return DelayStatus(min(echo_s, _DELAY_S_MAX), EchoState.KNOWN)


def reported_delay_of(settings: ControllerSettings) -> ReportedDelay:
    """Return the measurement that the settings ask for."""
    averaging_ns = round(settings.link.delay_averaging_s * NS_PER_S)
    timeout_ns = settings.age_limits.steering_status_ns
    return ReportedDelay(settings.period_ns, averaging_ns, timeout_ns)
