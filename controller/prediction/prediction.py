"""Prediction to the time at which a command acts, and the feedback of the state there."""

from ...runtime.fast_named_tuple import new_record
from ..history.echo_delay import LoopDelayParams
from ..law_interface import History, LoopDelay
from .vehicle_kalman_filter import EstimatorState, VehicleGains, command_from, step_on_path


def horizon_samples(p: LoopDelayParams, loop_delay: LoopDelay, sample: int) -> float:
    """Return the number of samples from ``sample`` until the wheel takes up this tick's command."""
    acts_ns = loop_delay.tick * p.period_ns + loop_delay.delay_ns
    return acts_ns / p.sensor_period_ns + p.dead_samples - sample


def predict(
    p: LoopDelayParams,
    g: VehicleGains,
    x: EstimatorState,
    loop_delay: LoopDelay,
    history: History,
    horizon: float,
) -> EstimatorState:
    """Return the state ``horizon`` samples ahead, interpolated linearly between two samples."""
    after, sample, horizon = x, x.sample, max(horizon, 0.0)
    last = sample + int(horizon)
    while sample <= last:
        x = after
        command_rad = command_from(p, loop_delay, history, sample)
        after = step_on_path(g, loop_delay, history, x, command_rad)
        sample += 1
    part = horizon % 1.0
    sample, beta, r, psi, y, rho, d, delta, behind = x
    _, beta_1, r_1, psi_1, y_1, rho_1, _, delta_1, _ = after
    between = (
        sample,
        beta + part * (beta_1 - beta),
        r + part * (r_1 - r),
        psi + part * (psi_1 - psi),
        y + part * (y_1 - y),
        rho + part * (rho_1 - rho),
        d,
        delta + part * (delta_1 - delta),
        behind,
    )
    return new_record(EstimatorState, between)


def steer_for(g: VehicleGains, x: EstimatorState, steer_rad_max: float) -> float:
    """Return the command for a state, ``steer_rad_max`` to either side at most [rad].

    The lateral error may ask for half of that. So the vehicle approaches its path at a bounded
    angle, and the other half can turn it back in time.
    """
    by_beta, by_r, by_psi, by_y, by_delta, by_rho, by_d = g[25:32]
    _, beta, r, psi, y, rho, d, delta, _ = x
    towards_rad, half_rad = by_y * y, 0.5 * steer_rad_max
    if towards_rad > half_rad:
        towards_rad = half_rad
    elif towards_rad < -half_rad:
        towards_rad = -half_rad
    steer_rad = (
        by_rho * rho
        + by_d * d
        - (by_beta * beta + by_r * r)
        - (by_psi * psi + towards_rad)
        - by_delta * delta
    )
    if steer_rad > steer_rad_max:
        return steer_rad_max
    return -steer_rad_max if steer_rad < -steer_rad_max else steer_rad
