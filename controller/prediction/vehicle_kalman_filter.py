"""Kalman filter for the vehicle and its disturbances, stepped by the plant's sample numbers.

State: side slip β, yaw rate r, heading error Δψ and lateral error y of SAE 2018-01-1086 (1), and

    ρ   curvature of the path      random walk
    d   steering offset            random walk; a side force, a bank or a wrong mass look like it
    δ   angle of the wheel         lag from the command to the wheel, if there is one

    x[k+1] = F x[k] + G u[k],   (y, Δψ, r)[k] = H x[k]   sampled at the sensors' period
    x ← x + K ((y, Δψ, r) - H x)                         where the sample's LATERAL_ERROR came

K at each speed (``controller.prediction.gains_over_speed``) is the steady-state gain where the
sample before was measured, too. After a gap it weighs the measurement as what the model has lost
by then, for the next of 2, 4 ... ``GAP_MAX`` samples: the steady-state gain would let the error
grow where only every third or fourth measurement comes. r is used where the estimator's settings
give its noise and the sample's VEHICLE_STATE came, also without the sample's LATERAL_ERROR.
u[k] is what the plant reported as applied from sample k to k + 1: the command named by the echo, or
the wheel angle while the steering overrules commands (hold, fallback, limits). With a lag the
reported wheel angle is used too: what a step of the model does not explain is taken for another
lag, and a part of it for an offset, as of play.

A measurement is used at the sample at which it was taken. The filter stays at the newest sample
whose measurement and echo are both known or definitely lost. From there it runs ahead, again at
every tick, through data that arrived early.
"""

from collections.abc import Sequence
from typing import NamedTuple

from ...runtime.fast_named_tuple import new_record
from ..history.echo_delay import LoopDelayParams
from ..history.plan import value_at
from ..law_interface import History, LoopDelay

DISCARDED_AFTER = 256
"""Samples without an echo and a measurement after which the estimate is discarded."""
_SETTLES_S = 1.0
"""Time after which the filter knows yaw rate and side slip from any initial state."""
_STAYS_BEHIND = 0.1
"""Part of a difference between wheel and model that is taken for an offset; chosen."""
GAP_DOUBLINGS = 6
GAP_MAX = 2**GAP_DOUBLINGS
"""Samples from one measurement to the next for which there is a gain: as long as a controller
without measurements holds its command. The error decays at every gap up to 77."""


def settling_samples(sensor_period_s: float) -> int:
    """Return for how many samples a law does not use the filter after its start."""
    return round(_SETTLES_S / sensor_period_s)


class Correction(NamedTuple):
    """K after a gap, by row and column."""

    beta_from_y: float
    beta_from_psi: float
    beta_from_r: float
    r_from_y: float
    r_from_psi: float
    r_from_r: float
    psi_from_y: float
    psi_from_psi: float
    psi_from_r: float
    y_from_y: float
    y_from_psi: float
    y_from_r: float
    rho_from_y: float
    rho_from_psi: float
    rho_from_r: float
    d_from_y: float
    d_from_psi: float
    d_from_r: float


class VehicleGains(NamedTuple):
    """F and G at one speed, by row and column; the feedback, zeros where there is none; and K.

    Entries of F that are 0 or 1 for every vehicle are omitted.

    ``corrections``  K after gaps of 1, 2, 4 ... ``GAP_MAX`` samples
    """

    beta_beta: float
    beta_r: float
    beta_d: float
    beta_delta: float
    beta_u: float
    r_beta: float
    r_r: float
    r_d: float
    r_delta: float
    r_u: float
    psi_beta: float
    psi_r: float
    psi_rho: float
    psi_d: float
    psi_delta: float
    psi_u: float
    y_beta: float
    y_r: float
    y_psi: float
    y_rho: float
    y_d: float
    y_delta: float
    y_u: float
    delta_delta: float
    delta_u: float
    steer_beta: float
    steer_r: float
    steer_psi: float
    steer_y: float
    steer_delta: float
    steer_rho: float
    steer_d: float
    corrections: tuple[Correction, ...]


def row_of(table: Sequence[VehicleGains], index: int) -> VehicleGains:
    """Return one of many gains; compiled code has the table's address in its place."""
    return table[index]


def correction_of(table: Sequence[Correction], index: int) -> Correction:
    """Return one of many corrections; compiled code has the table's address in its place."""
    return table[index]


class EstimatorState(NamedTuple):
    """The estimate at one sample; ``sample`` is -1 before the first.

    ``behind_rad``  the part of the offset by which the wheel stays behind the commands
    """

    sample: int
    side_slip_rad: float
    yaw_rate_rad_s: float
    heading_error_rad: float
    lateral_error_m: float
    curvature_1_m: float
    offset_rad: float
    wheel_rad: float
    behind_rad: float = 0.0


def estimator_at_rest(lateral_error_m: float) -> EstimatorState:
    """Return the estimate of a vehicle at rest next to its path, before the first sample."""
    return EstimatorState(-1, 0.0, 0.0, 0.0, lateral_error_m, 0.0, 0.0, 0.0, 0.0)


def model_step(
    g: VehicleGains, x: EstimatorState, command_rad: float, change_1_m: float = 0.0
) -> EstimatorState:
    """Return the state one sample later, with a mean command of ``command_rad`` in between.

    ``change_1_m``  of the path's curvature until then
    """
    sample, beta, r, psi, y, rho, d, delta, behind = x
    # A slice is a plain tuple: to take it apart takes less than half as long as the names.
    (
        beta_beta, beta_r, beta_d, beta_delta, beta_u, r_beta, r_r, r_d, r_delta, r_u,
        psi_beta, psi_r, psi_rho, psi_d, psi_delta, psi_u,
        y_beta, y_r, y_psi, y_rho, y_d, y_delta, y_u, delta_delta, delta_u,
    ) = g[:25]  # fmt: skip
    after = (
        sample + 1,
        beta_beta * beta + beta_r * r + beta_d * d + beta_delta * delta + beta_u * command_rad,
        r_beta * beta + r_r * r + r_d * d + r_delta * delta + r_u * command_rad,
        psi
        + psi_beta * beta
        + psi_r * r
        + psi_rho * rho
        + psi_d * d
        + psi_delta * delta
        + psi_u * command_rad,
        y
        + y_beta * beta
        + y_r * r
        + y_psi * psi
        + y_rho * rho
        + y_d * d
        + y_delta * delta
        + y_u * command_rad,
        rho + change_1_m,
        d,
        delta_delta * delta + delta_u * command_rad,
        behind,
    )
    return new_record(EstimatorState, after)


def step_on_path(
    g: VehicleGains, loop_delay: LoopDelay, history: History, x: EstimatorState, command_rad: float
) -> EstimatorState:
    """Return the predicted state, with the curvature of the path ahead where that is known.

    Only the change is used: the estimate itself also contains disturbances that look like a
    curvature.
    """
    sample, change_1_m = x.sample, 0.0
    if sample < loop_delay.path_end:
        known_1_m, mask = history.curvature_1_m, history.sample_mask
        change_1_m = known_1_m[(sample + 1) & mask] - known_1_m[sample & mask]
    return model_step(g, x, command_rad, change_1_m)


def correction_at(g: VehicleGains, history: History, sample: int) -> Correction:
    """Return K for a sample, by the samples since the measurement before it."""
    gap, row, reach = 1, 0, 1
    while gap < GAP_MAX and not history.has_error[(sample - gap) & history.sample_mask]:
        gap += 1
        if gap > reach:
            row, reach = row + 1, 2 * reach
    return correction_of(g.corrections, row)


def correction_step(
    k: Correction,
    x: EstimatorState,
    lateral_error_m: float,
    heading_error_rad: float,
    yaw_rate_rad_s: float,
) -> EstimatorState:
    """Return the state corrected by the measurements of its sample."""
    sample, beta, r, psi, y, rho, d, delta, behind = x
    e_y, e_psi, e_r = lateral_error_m - y, heading_error_rad - psi, yaw_rate_rad_s - r
    (
        beta_y, beta_psi, beta_r, r_y, r_psi, r_r, psi_y, psi_psi, psi_r,
        y_y, y_psi, y_r, rho_y, rho_psi, rho_r, d_y, d_psi, d_r,
    ) = k  # fmt: skip
    corrected = (
        sample,
        beta + (beta_y * e_y + beta_psi * e_psi + beta_r * e_r),
        r + (r_y * e_y + r_psi * e_psi + r_r * e_r),
        psi + (psi_y * e_y + psi_psi * e_psi + psi_r * e_r),
        y + (y_y * e_y + y_psi * e_psi + y_r * e_r),
        rho + (rho_y * e_y + rho_psi * e_psi + rho_r * e_r),
        d + (d_y * e_y + d_psi * e_psi + d_r * e_r),
        delta,
        behind,
    )
    return new_record(EstimatorState, corrected)


def sent_for(history: History, tick: int, sample: int) -> float:
    """Return the angle that a tick's command or plan sets at a sample [rad]; 0 before the first."""
    if tick < 0:
        return 0.0
    if history.plan_mask:
        return value_at(history.plans[tick & history.plan_mask], sample)
    return history.sent_rad[tick & history.tick_mask]


def _input_at(history: History, sample: int) -> float:
    """Return the wheel's input at a sample with an echo [rad]."""
    index = sample & history.sample_mask
    if history.is_overruled[index]:
        return history.wheel_rad[index]
    return sent_for(history, history.applied_tick[index], sample)


def command_from(p: LoopDelayParams, loop_delay: LoopDelay, history: History, sample: int) -> float:
    """Return the mean command that the wheel takes up from ``sample`` to the next [rad].

    It is as echoed, or as expected, a dead time before.
    """
    period_ns, sensor_period_ns, _, dead_samples, _ = p
    tick_now, _, echo_sample, delay_ns, _, _, _ = loop_delay
    applied_tick, mask = history.applied_tick, history.sample_mask
    if dead_samples:
        sample = max(sample - dead_samples, 0)
    if sample < echo_sample:
        before, after = sample & mask, (sample + 1) & mask
        if history.is_overruled[before] or history.is_overruled[after]:
            return 0.5 * (_input_at(history, sample) + _input_at(history, sample + 1))
        tick, tick_after = applied_tick[before], applied_tick[after]
        steer_rad = sent_for(history, tick, sample)
        if tick == tick_after or _begins_at_a_sample(history, tick_after):
            return steer_rad
        # The time of the change between the two samples is unknown.
        return 0.5 * (steer_rad + sent_for(history, tick_after, sample))
    earliest = applied_tick[echo_sample & mask] if echo_sample >= 0 else -1
    begin = (sample * sensor_period_ns - delay_ns) / period_ns
    if history.plan_mask:
        tick = min(max(int(begin // 1.0), earliest), tick_now - 1)
        return sent_for(history, tick, sample)
    return _mean_command(history, begin, sensor_period_ns / period_ns, earliest, tick_now - 1)


def _begins_at_a_sample(history: History, tick: int) -> bool:
    """Whether a tick sent a plan: it is played from sample to sample, a command acts at once."""
    return history.plan_mask != 0 and history.plans[tick & history.plan_mask][1] != 0.0


def _mean_command(
    history: History, begin: float, length: float, earliest: int, latest: int
) -> float:
    """Return the mean over ``begin`` to ``begin + length``, in periods of the controller.

    A command older than ``earliest`` is no longer in effect; one newer than ``latest`` is not sent.
    """
    sent_rad, mask, until = history.sent_rad, history.tick_mask, begin + length
    tick, position, total = int(begin // 1.0), begin, 0.0
    while position < until:
        end, acting = tick + 1.0, tick
        if end > until:
            end = until
        if acting < earliest:
            acting = earliest
        if acting > latest:
            acting = latest
        total += (end - position) * (sent_rad[acting & mask] if acting >= 0 else 0.0)
        tick, position = tick + 1, end
    return total / length


def at_measured_wheel(
    g: VehicleGains, loop_delay: LoopDelay, history: History, x: EstimatorState
) -> EstimatorState:
    """Return the state with the wheel's angle as its sample's STEERING_STATUS reports it.

    A lost sample has the values of the one before, and with them the same command.
    """
    sample, beta, r, psi, y, rho, d, delta, behind = x
    if g.delta_delta == 0.0 or sample > loop_delay.echo_sample:
        return x
    at, before = sample & history.sample_mask, (sample - 1) & history.sample_mask
    tick = history.applied_tick[at]
    if tick < 0 or tick == history.applied_tick[before]:
        return x
    more = history.wheel_rad[at] - behind - delta
    part = _STAYS_BEHIND * more
    delta, d, behind = delta + (more - part), d + part, behind + part
    return EstimatorState(sample, beta, r, psi, y, rho, d, delta, behind)


def estimate_to(
    p: LoopDelayParams,
    g: VehicleGains,
    x: EstimatorState,
    loop_delay: LoopDelay,
    history: History,
    sample: int,
) -> EstimatorState:
    """Return the estimate at ``sample``, using the measurements up to it."""
    while x.sample < sample:
        x = step_on_path(g, loop_delay, history, x, command_from(p, loop_delay, history, x.sample))
        x = at_measured_wheel(g, loop_delay, history, x)
        index = x.sample & history.sample_mask
        has_error = history.has_error[index]
        has_yaw_rate = p.yaw_rate_samples > 0 and history.yaw_rate_sample[index] == x.sample
        if has_error or has_yaw_rate:
            k = correction_at(g, history, x.sample)
            # What has not come is as the model has it.
            error_m, heading_rad = x.lateral_error_m, x.heading_error_rad
            yaw_rate_rad_s = x.yaw_rate_rad_s
            if has_error:
                error_m = history.lateral_error_m[index]
                heading_rad = history.heading_error_rad[index]
            if has_yaw_rate:
                yaw_rate_rad_s = history.yaw_rate_rad_s[index]
            x = correction_step(k, x, error_m, heading_rad, yaw_rate_rad_s)
    return x


def start_estimate(x: EstimatorState, loop_delay: LoopDelay, history: History) -> EstimatorState:
    """Return the state to continue from; a new one if there is none or it is too old."""
    known = min(loop_delay.error_sample, loop_delay.echo_sample)
    if x.sample >= 0 and known - x.sample <= DISCARDED_AFTER:
        return x
    index = known & history.sample_mask
    if known < 0 or not history.has_error[index]:
        return estimator_at_rest(x.lateral_error_m)
    heading_rad, error_m = history.heading_error_rad[index], history.lateral_error_m[index]
    curvature_1_m = history.curvature_1_m[index] if known <= loop_delay.path_end else 0.0
    return EstimatorState(known, 0.0, 0.0, heading_rad, error_m, curvature_1_m, 0.0, 0.0, 0.0)
