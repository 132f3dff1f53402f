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

from typing import NamedTuple

from ...dbc.messages import DelayStatus, EchoState, limits
from ...runtime.fast_named_tuple import new_record
from ...runtime.node import NS_PER_S
from ..settings import ControllerSettings

_DELAY_S_MAX = limits(DelayStatus)["echo_delay_s"].maximum
_NS_PER_S = float(NS_PER_S)


class EchoRule(NamedTuple):
    """Time constant of the mean, and after which time without an echo it is unknown [ns]."""

    half_period_ns: float
    averaging_ns: float
    timeout_ns: int


def echo_rule(settings: ControllerSettings) -> EchoRule:
    """Return the parameters that the settings ask for."""
    averaging_ns = float(round(settings.link.delay_averaging_s * NS_PER_S))
    return EchoRule(settings.period_ns / 2, averaging_ns, settings.age_limits.steering_status_ns)


class EchoMean(NamedTuple):
    """When the newest echo came, None before the first, and the mean delay of echoes [ns]."""

    echo_ns: int | None
    mean_ns: float


NO_ECHO = EchoMean(None, 0.0)


def echo_step(p: EchoRule, x: EchoMean, sent_ns: int, now_ns: int) -> EchoMean:
    """Take an echo of a command by when that was sent."""
    echo_ns, mean_ns = x
    weight = 1.0
    if echo_ns is not None and now_ns - echo_ns <= p.timeout_ns:
        weight = min(float(now_ns - echo_ns) / p.averaging_ns, 1.0)
    mean_ns = mean_ns + weight * (float(now_ns - sent_ns) - mean_ns)
    return new_record(EchoMean, (now_ns, mean_ns))


def echo_delay_s(p: EchoRule, x: EchoMean, now_ns: int) -> float | None:
    """Return the delay [s], None if the last echo is older than the timeout."""
    if x.echo_ns is None or now_ns - x.echo_ns > p.timeout_ns:
        return None
    return max(0.0, (x.mean_ns - p.half_period_ns) / _NS_PER_S)


def delay_status(delay_s: float | None) -> DelayStatus:
    """Return the message; the delay is clamped to the range of its signal."""
    if delay_s is None:
        return DelayStatus(echo_delay_s=0.0, echo_state=EchoState.UNKNOWN)
    return DelayStatus(echo_delay_s=min(delay_s, _DELAY_S_MAX), echo_state=EchoState.KNOWN)
