"""The steering's lag T, measured on the bus: the wheel angle against the commands in effect.

STEERING_STATUS has both, the angle δ of the wheel and the counter of the command u in effect. With
a lag of first order and the sensors' period P,

    δ[k+1] = α δ[k] + b u[k] + (1 - α - b) u[k+1],   α = exp(-P/T)

where b depends on when the command changed between the two samples: it is unknown, and constant as
long as the latency is. A Kalman filter whose state (α, b) walks slowly sees

    δ[k+1] - u[k+1] = α (δ[k] - u[k+1]) + b (u[k] - u[k+1])

A sample whose STEERING_STATUS was lost, or at which the steering overruled the command, shows
nothing. The law has gains for a few lags (``LAGS_S``), and takes those of the lag nearest to the
measured one once its deviation is small against it; until then those of the settings. Plain
arithmetic; filterpy's filter is the reference (``tests/controller/prediction/test_lag_filter.py``).
"""

from math import log, sqrt
from typing import NamedTuple

from ..history.echo_delay import LoopDelayParams
from ..law_interface import History, LoopDelay
from .regression import regressed
from .vehicle_kalman_filter import sent_for

LAGS_S = (0.0, 0.02, 0.05, 0.1, 0.2, 0.4)
"""Lags that there are gains for, in addition to that of the settings."""
AS_SET = 0
"""Choice of the settings' lag; the others are 1 + their place in LAGS_S."""
_ENDS_S = (0.01, 0.032, 0.07, 0.14, 0.28)
"""Limits between neighbours, beyond which the next is taken; geometric means from the second on."""
_HYSTERESIS = 1.15
_NOISE_RAD2 = 1e-4 * 1e-4
"""Variance of the residual: resolutions, and commands that change at another time than expected."""
_WALK_PER_SAMPLE = 1e-7
"""Variance that both coefficients gain: 0.3 % in a second at 100 Hz."""
_VARIANCE_MAX = 1.0
_RELATIVE_DEVIATION_MAX = 0.2
_NO_LAG_ALPHA = 0.2
"""Below it T is under two thirds of a sensor period, which is no lag to the law."""
_FORGETS_AFTER = 256


class LagState(NamedTuple):
    """The filter at a sample, -1 before the first; ``variance_*`` of α and b.

    ``is_received``  whether that sample's STEERING_STATUS came
    ``choice``       which gains the law takes: AS_SET, or 1 + a place in LAGS_S
    """

    sample: int
    is_received: bool
    alpha: float
    b: float
    variance_aa: float
    variance_ab: float
    variance_bb: float
    choice: int


NO_LAG = LagState(-1, False, 0.0, 0.0, _VARIANCE_MAX, 0.0, _VARIANCE_MAX, AS_SET)


def lag_to(p: LoopDelayParams, x: LagState, loop_delay: LoopDelay, history: History) -> LagState:
    """Return the filter at the newest echo."""
    if x.sample < 0 or loop_delay.echo_sample - x.sample > _FORGETS_AFTER:
        return LagState(loop_delay.echo_sample, False, *x[2:])
    if x.sample >= loop_delay.echo_sample:
        return x
    while x.sample < loop_delay.echo_sample:
        x = lag_step(x, history)
    return LagState(*x[:7], chosen(1e-9 * p.sensor_period_ns, x))


def lag_step(x: LagState, history: History) -> LagState:
    """Advance the filter by one sample."""
    sample, was_received, alpha, b, p_aa, p_ab, p_bb, choice = x
    before, after = sample & history.sample_mask, (sample + 1) & history.sample_mask
    wheel_rad, wheel_after_rad = history.wheel_rad[before], history.wheel_rad[after]
    tick, tick_after = history.applied_tick[before], history.applied_tick[after]
    # A lost sample has the values of the one before.
    is_received = tick != tick_after or wheel_rad != wheel_after_rad
    is_overruled = history.is_overruled[before] or history.is_overruled[after]
    p_aa = min(p_aa + _WALK_PER_SAMPLE, _VARIANCE_MAX)
    p_bb = min(p_bb + _WALK_PER_SAMPLE, _VARIANCE_MAX)
    if is_received and was_received and tick >= 0 and not is_overruled:
        u, u_after = sent_for(history, tick, sample), sent_for(history, tick_after, sample + 1)
        alpha, b, p_aa, p_ab, p_bb = regressed(
            (alpha, b, p_aa, p_ab, p_bb),
            wheel_rad - u_after,
            u - u_after,
            wheel_after_rad - u_after,
            _NOISE_RAD2,
        )
    return LagState(sample + 1, is_received, alpha, b, p_aa, p_ab, p_bb, choice)


def lag_of(period_s: float, x: LagState) -> float:
    """Return T [s]."""
    return -period_s / log(min(x.alpha, 0.9999)) if x.alpha > 1e-9 else 0.0


def is_known(x: LagState) -> bool:
    """Whether the lag's deviation is small: that of ln α, or of α itself where there is no lag."""
    deviation = sqrt(x.variance_aa)
    if x.alpha + 2.0 * deviation < _NO_LAG_ALPHA:
        return True
    alpha = min(x.alpha, 0.9999)
    return alpha > 0.0 and deviation < _RELATIVE_DEVIATION_MAX * alpha * -log(alpha)


def chosen(period_s: float, x: LagState) -> int:
    """Return which gains to take: the present ones as long as the lag is near theirs."""
    if not is_known(x):
        return x.choice
    lag_s, place = lag_of(period_s, x), x.choice - 1
    if place < 0:
        place = 0
        while place < len(_ENDS_S) and lag_s > _ENDS_S[place]:
            place += 1
    while place < len(_ENDS_S) and lag_s > _HYSTERESIS * _ENDS_S[place]:
        place += 1
    while place > 0 and lag_s * _HYSTERESIS < _ENDS_S[place - 1]:
        place -= 1
    return place + 1
