"""dy/dt from the Kalman filter, for any law that takes a derivative. Not in SAE 2018-01-1086.

    u = u_law - C (0 - y) - (K_p y + K_d ẏ),     ẏ = V β + l_s r + V Δψ

The law itself is unchanged. In the response of its C(s) to the measured error, the derivative is
replaced by that of the filter (``controller.prediction.vehicle_kalman_filter``) at its newest
sample, without prediction. The CDOB's compensation has hardly any noise and keeps the filtered
difference. As always, the observers see the command that was sent.

Without echoes the filter does not know which commands act. Before the first echo, when echoes stop,
and until the filter has settled afterwards, the filtered difference is used. At each change the
difference between the two fades out.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

from ..filters.pd_filter import PdParams, pd_at_rest, pd_step
from ..filters.sections import SectionState
from ..history.echo_delay import LoopDelayParams
from ..law_interface import LawInput, LawOutput, LawStep
from ..limits.fades_and_ramps import NOTHING, Fading, fading_step
from ..prediction.vehicle_kalman_filter import (
    EstimatorState,
    VehicleGains,
    estimate_to,
    estimator_at_rest,
    start_estimate,
)


class DerivativeParams(NamedTuple):
    """Parameters of the derivative at one speed.

    ``pd``             C(z) of the law
    ``fade_step_rad``  how much of a difference between the two derivatives fades in one period
    ``settling_samples``  samples until the filter has settled after its start or a gap in echoes
    """

    gains: VehicleGains
    loop_delay: LoopDelayParams
    pd: PdParams
    proportional_gain_rad_m: float
    derivative_gain_rad_s_m: float
    speed_m_s: float
    preview_distance_m: float
    fade_step_rad: float
    settling_samples: int


class DerivativeState(NamedTuple):
    """State of the derivative.

    ``settled_sample``  from this sample on the filter is used
    ``correction``      of the command [rad], for the estimated derivative or the filtered one
    """

    estimate: EstimatorState
    settled_sample: int
    pd: SectionState
    correction: Fading


class KalmanParams(NamedTuple):
    """Parameters of the law inside, and of the derivative."""

    law: Any
    derivative: DerivativeParams


class KalmanState(NamedTuple):
    """State of the same two."""

    law: Any
    derivative: DerivativeState


def derivative_step(
    p: DerivativeParams, x: DerivativeState, observed: LawInput
) -> tuple[DerivativeState, float]:
    """Advance one period; returns what to add to the law's command [rad]."""
    loop_delay, history = observed.link, observed.history
    x_pd, filtered_rad = pd_step(p.pd, x.pd, observed.lateral_error_m)
    estimate = start_estimate(x.estimate, loop_delay, history)
    settled_sample = x.settled_sample
    if estimate.sample != x.estimate.sample or not loop_delay.is_measured:
        settled_sample = max(loop_delay.error_sample, 0) + p.settling_samples
    wanted_rad = 0.0
    if estimate.sample >= 0:
        known = min(loop_delay.error_sample, loop_delay.echo_sample)
        estimate = estimate_to(p.loop_delay, p.gains, estimate, loop_delay, history, known)
    is_estimated = loop_delay.is_measured and 0 <= settled_sample <= estimate.sample
    if is_estimated:
        newest = estimate_to(
            p.loop_delay, p.gains, estimate, loop_delay, history, loop_delay.error_sample
        )
        wanted_rad = (
            -p.proportional_gain_rad_m * observed.lateral_error_m
            - p.derivative_gain_rad_s_m * error_rate_m_s(p, newest)
            - filtered_rad
        )
    correction = fading_step(p.fade_step_rad, x.correction, wanted_rad, is_estimated)
    return DerivativeState(estimate, settled_sample, x_pd, correction), correction.value


def error_rate_m_s(p: DerivativeParams, x: EstimatorState) -> float:
    """Return dy/dt of an estimate [m/s], (1)."""
    return (
        p.speed_m_s * (x.side_slip_rad + x.heading_error_rad)
        + p.preview_distance_m * x.yaw_rate_rad_s
    )


def kalman_step(
    law_step: LawStep, p: KalmanParams, x: KalmanState, observed: LawInput
) -> tuple[KalmanState, LawOutput]:
    """Advance the law inside by one period, whose step is ``law_step``, and correct its command."""
    x_law, output = law_step(p.law, x.law, observed)
    x_derivative, correction_rad = derivative_step(p.derivative, x.derivative, observed)
    corrected = LawOutput(output.steer_rad + correction_rad, *output[1:])
    return KalmanState(x_law, x_derivative), corrected


def kalman_at_rest(
    law_at_rest: Callable[[float], Any], p: DerivativeParams, lateral_error_m: float
) -> KalmanState:
    """Return the state around a law's after a constant lateral error [m] and no steering."""
    x_pd = pd_at_rest(p.pd, lateral_error_m)
    derivative = DerivativeState(estimator_at_rest(lateral_error_m), -1, x_pd, NOTHING)
    return KalmanState(law_at_rest(lateral_error_m), derivative)
