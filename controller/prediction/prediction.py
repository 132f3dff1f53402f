"""Prediction to the time at which a command acts, and the feedback of the state there."""

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
    after = x
    last = x.sample + int(max(horizon, 0.0))
    while after.sample <= last:
        x = after
        after = step_on_path(
            g, loop_delay, history, x, command_from(p, loop_delay, history, x.sample)
        )
    part = max(horizon, 0.0) % 1.0
    return EstimatorState(
        x.sample,
        x.side_slip_rad + part * (after.side_slip_rad - x.side_slip_rad),
        x.yaw_rate_rad_s + part * (after.yaw_rate_rad_s - x.yaw_rate_rad_s),
        x.heading_error_rad + part * (after.heading_error_rad - x.heading_error_rad),
        x.lateral_error_m + part * (after.lateral_error_m - x.lateral_error_m),
        x.curvature_1_m + part * (after.curvature_1_m - x.curvature_1_m),
        x.offset_rad,
        x.wheel_rad + part * (after.wheel_rad - x.wheel_rad),
        x.behind_rad,
    )


def steer_for(g: VehicleGains, x: EstimatorState, steer_rad_max: float) -> float:
    """Return the command for a state, ``steer_rad_max`` to either side at most [rad].

    The lateral error may ask for half of that. So the vehicle approaches its path at a bounded
    angle, and the other half can turn it back in time.
    """
    towards_rad, half_rad = g.steer_y * x.lateral_error_m, 0.5 * steer_rad_max
    if towards_rad > half_rad:
        towards_rad = half_rad
    elif towards_rad < -half_rad:
        towards_rad = -half_rad
    steer_rad = (
        g.steer_rho * x.curvature_1_m
        + g.steer_d * x.offset_rad
        - (g.steer_beta * x.side_slip_rad + g.steer_r * x.yaw_rate_rad_s)
        - (g.steer_psi * x.heading_error_rad + towards_rad)
        - g.steer_delta * x.wheel_rad
    )
    if steer_rad > steer_rad_max:
        return steer_rad_max
    return -steer_rad_max if steer_rad < -steer_rad_max else steer_rad
