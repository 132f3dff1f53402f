"""Gains of the predictor's filter and feedback, for every speed.

The model is SAE 2018-01-1086 (1) with (2) corrected as in ``controller.filters.nominal_model``, and
with a steering offset d and the wheel's lag T_a:

    β'  = a11 β + a12 r + b11 (δ + d)        Δψ' = r - V ρ              ρ' = noise
    r'  = a21 β + a22 r + b21 (δ + d)        y'  = V β + l_s r + V Δψ   d' = noise
    δ'  = (u - δ)/T_a,  or δ = u without a lag

The model is sampled exactly for a held command. The filter is the steady-state one for white noise
on β', r' and the two random walks, and for the noise of the measurements; after a gap its gain is
K_n = P_n Hᵀ (H P_n Hᵀ + R)⁻¹, with the covariance P_n that n samples without a measurement leave of
the steady state's. The feedback minimises the cost (k y_p)² + (u - u_ss)², with the weight k in
steer per metre and the deviation y_p of the followed point, d behind the preview point:

    y_p = y - d Δψ - d² ρ/2

The gains are tabulated over speed in geometric steps, and interpolated linearly. Beyond the largest
speed of the settings, V_max, the table continues with the weight k (V_max/V)²: the vehicle's gain
from steer to lateral acceleration goes with V², and nothing is known of the loop there.
"""

from bisect import bisect_right
from collections.abc import Callable, Iterable, Sequence
from math import log
from typing import Annotated, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from ...runtime.settings import Settings, SettingsError
from ..filters.nominal_model import NominalVehicle, motion_coefficients, understeer_gradient_s2_m
from ..filters.settings import VehicleModelSettings
from ..matrices import Matrix, zero_order_hold
from .riccati_equation import UnsolvableError, feedback_gain, filter_gains
from .vehicle_kalman_filter import GAP_DOUBLINGS, Correction, VehicleGains

BETA, R, PSI, Y, RHO, D, DELTA = range(7)
_SPEEDS_PER_DOUBLING = 8
SPEED_M_S_MAX = 82.0
"""Just beyond what VEHICLE_STATE can carry."""
_SPEED_M_S_MIN = 0.1
"""Below, a turn takes more steer than any wheel has."""
_MEASURED = (Y, PSI, R)
_FREE = (BETA, R, PSI, Y)
_FILTERED = (BETA, R, PSI, Y, RHO, D)


class EstimatorSettings(Settings):
    """[estimator]: noise that the Kalman filter assumes, and speeds for which it is designed.

    Noise densities are standard deviations after one second; those of measurements are per sample.
    """

    lateral_error_noise_m: Annotated[float, Field(ge=1e-6, le=10.0)] = 0.002
    heading_error_noise_rad: Annotated[float, Field(ge=1e-6, le=10.0)] = 0.002
    side_slip_noise_rad_sqrt_s: Annotated[float, Field(gt=0.0, le=10.0)] = 0.001
    yaw_rate_noise_rad_s_sqrt_s: Annotated[float, Field(gt=0.0, le=10.0)] = 0.01
    curvature_walk_1_m_sqrt_s: Annotated[float, Field(gt=0.0, le=10.0)] = 0.02
    steering_offset_walk_rad_sqrt_s: Annotated[float, Field(gt=0.0, le=10.0)] = 0.005
    yaw_rate_sensor_noise_rad_s: Annotated[float, Field(ge=1e-6, le=10.0)] | None = None
    """Of VEHICLE_STATE's yaw rate; None: the filter does not use it."""
    actuator_lag_s: Annotated[float, Field(ge=0.0, le=10.0)] = 0.0
    """Lag of the wheel behind the command, if known."""
    actuator_dead_time_s: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0
    """Time before that in which the wheel does not move, if known; in whole sensor periods."""
    speed_m_s_min: Annotated[float, Field(ge=0.1, le=80.0)] = 0.5
    speed_m_s_max: Annotated[float, Field(ge=0.1, le=80.0)] = 25.0

    @model_validator(mode="after")
    def _refuse_an_empty_range_of_speeds(self) -> Self:
        if self.speed_m_s_max <= self.speed_m_s_min:
            raise ValueError(
                f"speed_m_s_max = {self.speed_m_s_max:g} must be above"
                f" speed_m_s_min = {self.speed_m_s_min:g}"
            )
        return self


class SampledVehicle(NamedTuple):
    """F, shape (speeds, 7, 7), and G, (speeds, 7), over one period with a held command; states in
    the order β r Δψ y ρ d δ.
    """

    f: Matrix
    g: Matrix


class Feedback(NamedTuple):
    """What the feedback minimises.

    ``steer_per_error_rad_m``  weight k of the followed point's deviation
    ``speed_m_s_max``          up to which that weight holds
    ``behind_m``               d, of the followed point behind the preview point
    """

    steer_per_error_rad_m: float
    behind_m: float
    speed_m_s_max: float = SPEED_M_S_MAX


class GainSchedule(NamedTuple):
    """Gains at rising speeds [m/s]; ``rows`` has the numbers of each, shape (speeds, numbers)."""

    speeds_m_s: Sequence[float]
    rows: Matrix


def together(schedules: Iterable[GainSchedule]) -> Callable[[float], tuple[VehicleGains, ...]]:
    """Return the gains of each schedule as a function of the speed; all have the same speeds.

    Outside the table the gains are those at its nearer end.
    """
    tables = list(schedules)
    speeds_m_s, size = tables[0].speeds_m_s, tables[0].rows.shape[1]
    rows = np.concatenate([table.rows for table in tables], axis=1)

    def at(speed_m_s: float) -> tuple[VehicleGains, ...]:
        values = between(speeds_m_s, rows, speed_m_s).tolist()
        return tuple(
            _gains_of(values[first : first + size]) for first in range(0, len(values), size)
        )

    return at


def between(speeds_m_s: Sequence[float], tables: Matrix, speed_m_s: float) -> Matrix:
    """Return what a table, shape (speeds, ...), has at a speed: linear between two of its own."""
    after = bisect_right(speeds_m_s, speed_m_s)
    found: Matrix = tables[min(after, len(tables) - 1)]
    if 0 < after < len(tables):
        low, high = speeds_m_s[after - 1 : after + 1]
        before = tables[after - 1]
        found = before + (speed_m_s - low) / (high - low) * (found - before)
    return found


def _gains_of(row: Sequence[float]) -> VehicleGains:
    """Return gains from their numbers, those of K last."""
    model, size = len(VehicleGains._fields) - 1, len(Correction._fields)
    each = [row[first : first + size] for first in range(model, len(row), size)]
    return VehicleGains._make([*row[:model], tuple(map(Correction._make, each))])


def speeds_of(settings: EstimatorSettings) -> list[float]:
    """Return the table's speeds [m/s]."""
    low, high = settings.speed_m_s_min, settings.speed_m_s_max
    steps = max(1, round(_SPEEDS_PER_DOUBLING * log(high / low, 2.0)))
    beyond = max(0, round(_SPEEDS_PER_DOUBLING * log(SPEED_M_S_MAX / high, 2.0)))
    return [low * (high / low) ** (step / steps) for step in range(steps + beyond + 1)]


def design_schedule(
    settings: EstimatorSettings,
    vehicle: VehicleModelSettings,
    period_s: float,
    sensor_period_s: float,
    feedback: Feedback,
) -> GainSchedule:
    """Return the gains from the settings' least speed on; ``period_s`` is the controller's.

    Raises SettingsError if there are no gains at a speed, naming it.
    """
    speeds = speeds_of(settings)
    try:
        rows = _rows(settings, vehicle, speeds, period_s, sensor_period_s, feedback)
    except UnsolvableError as error:
        raise SettingsError(
            f"[estimator] has no gains at {speeds[error.place]:.4g} m/s: {error}; take noise and"
            " walks nearer to their defaults, or another range of speeds"
        ) from error
    return GainSchedule(speeds, rows)


def steady_turn_rad(
    vehicle: VehicleModelSettings, speed_m_s: float, acceleration_m_s2: float
) -> float:
    """Return the steer of a steady turn with a lateral acceleration [rad].

    a_y (L + K V²)/V²; that of a neutral vehicle, a_y L/V², from the critical speed of an
    oversteering one on.
    """
    wheelbase_m = vehicle.front_axle_distance_m + vehicle.rear_axle_distance_m
    squared = max(speed_m_s, _SPEED_M_S_MIN) ** 2
    turning_m = wheelbase_m + understeer_gradient_s2_m(vehicle.vehicle) * squared
    return acceleration_m_s2 / squared * (turning_m if turning_m > 0.0 else wheelbase_m)


def sampled_vehicles(
    settings: EstimatorSettings,
    vehicle: VehicleModelSettings,
    speeds_m_s: Sequence[float],
    period_s: float,
) -> SampledVehicle:
    """Return the sampled vehicle at each speed."""
    at_speeds = (at_speed(vehicle, speed_m_s) for speed_m_s in speeds_m_s)
    models = [continuous_vehicle(each, settings.actuator_lag_s) for each in at_speeds]
    a, b = map(np.array, zip(*models, strict=True))
    f, g = zero_order_hold(a, b, period_s)
    if settings.actuator_lag_s == 0.0:
        f[:, DELTA], f[:, :, DELTA], g[:, DELTA] = 0.0, 0.0, 1.0
    return SampledVehicle(f, g)


def noise_covariances(settings: EstimatorSettings, sensor_period_s: float) -> tuple[Matrix, Matrix]:
    """Return Q over a sensor period, order β r Δψ y ρ d, and R of y, Δψ and, if it is used, r."""
    densities = [
        settings.side_slip_noise_rad_sqrt_s,
        settings.yaw_rate_noise_rad_s_sqrt_s,
        0.0,
        0.0,
        settings.curvature_walk_1_m_sqrt_s,
        settings.steering_offset_walk_rad_sqrt_s,
    ]
    q = np.diag(np.square(densities)) * sensor_period_s
    noise = [settings.lateral_error_noise_m, settings.heading_error_noise_rad]
    if settings.yaw_rate_sensor_noise_rad_s is not None:
        noise.append(settings.yaw_rate_sensor_noise_rad_s)
    return q, np.diag(np.square(noise))


def _rows(
    settings: EstimatorSettings,
    vehicle: VehicleModelSettings,
    speeds_m_s: Sequence[float],
    period_s: float,
    sensor_period_s: float,
    feedback: Feedback,
) -> Matrix:
    """Return the numbers of the gains at each speed; raises UnsolvableError."""
    f, g = sampled_vehicles(settings, vehicle, speeds_m_s, sensor_period_s)
    q, r = noise_covariances(settings, sensor_period_s)
    # The yaw rate comes more rarely than the errors; K is that for a yaw rate at every sample.
    measured = np.eye(len(_FILTERED))[list(_MEASURED[: len(r)])]
    each_k = filter_gains(f[:, : len(_FILTERED), : len(_FILTERED)], measured, q, r, GAP_DOUBLINGS)
    steer = _feedback(settings, vehicle, speeds_m_s, period_s, feedback)
    columns = (BETA, R, D, DELTA)
    path = (BETA, R, RHO, D, DELTA)
    entries = (
        *((BETA, columns), (R, columns), (PSI, path)),
        *((Y, (BETA, R, PSI, RHO, D, DELTA)), (DELTA, (DELTA,))),
    )
    model = [part for row, of in entries for part in (f[:, row, of], g[:, row, np.newaxis])]
    unused = ((0, 0), (0, 0), (0, len(_MEASURED) - len(r)))
    corrections = [np.pad(k, unused).reshape(len(k), -1) for k in each_k]
    return np.concatenate([*model, steer, *corrections], axis=1)


def _feedback(
    settings: EstimatorSettings,
    vehicle: VehicleModelSettings,
    speeds_m_s: Sequence[float],
    period_s: float,
    feedback: Feedback,
) -> Matrix:
    """Return the feedback of β, r, Δψ, y and δ, and the feed-forward of ρ and d, (speeds, 7)."""
    behind_m = feedback.behind_m
    f, g = sampled_vehicles(settings, vehicle, speeds_m_s, period_s)
    has_lag = settings.actuator_lag_s > 0.0
    states = [*_FREE, DELTA] if has_lag else list(_FREE)
    deviation = np.zeros(len(states))
    deviation[Y], deviation[PSI] = 1.0, -behind_m
    weight = np.outer(deviation, deviation) * squared_weights(feedback, speeds_m_s)[:, None, None]
    system = f[:, states][:, :, states]
    k = feedback_gain(system, g[:, states, np.newaxis], weight, np.eye(1))[:, 0]
    held = np.array([steady_state(vehicle, speed_m_s, behind_m) for speed_m_s in speeds_m_s])
    of_wheel = k[:, 4] if has_lag else np.zeros(len(k))
    # u = u_ss - k (x - x_ss); a steering offset is cancelled by its negative, also in the wheel.
    by_curvature = held[:, DELTA].copy()
    for place, state in enumerate(states):
        by_curvature += k[:, place] * held[:, state]
    return np.column_stack((k[:, :4], of_wheel, by_curvature, -1.0 - of_wheel))


def squared_weights(feedback: Feedback, speeds_m_s: Sequence[float]) -> Matrix:
    """Return k² at each speed [rad²/m²]."""
    ratios = np.minimum(1.0, feedback.speed_m_s_max / np.array(speeds_m_s))
    # The table's speeds are rounded: the last one of the settings may lie above it.
    ratios[ratios > 1.0 - 1e-9] = 1.0
    weights_rad_m = feedback.steer_per_error_rad_m * ratios * ratios
    squared: Matrix = weights_rad_m * weights_rad_m
    return squared


def steady_state(
    vehicle: VehicleModelSettings, speed_m_s: float, behind_m: float
) -> Sequence[float]:
    """Return the state that holds the followed point on a path of curvature 1/m, as above."""
    a, b = (m.tolist() for m in continuous_vehicle(at_speed(vehicle, speed_m_s), 0.0))
    yaw_rate = speed_m_s
    determinant = a[BETA][BETA] * b[R] - a[R][BETA] * b[BETA]
    side_slip = yaw_rate * (b[BETA] * a[R][R] - b[R] * a[BETA][R]) / determinant
    wheel = yaw_rate * (a[R][BETA] * a[BETA][R] - a[BETA][BETA] * a[R][R]) / determinant
    heading_error = -side_slip - vehicle.preview_distance_m
    lateral_error = behind_m * heading_error + 0.5 * behind_m * behind_m
    return side_slip, yaw_rate, heading_error, lateral_error, 1.0, 0.0, wheel


def continuous_vehicle(vehicle: NominalVehicle, lag_s: float) -> tuple[Matrix, Matrix]:
    """Return the model in continuous time; without a lag the wheel angle is the input."""
    a, b, steer = np.zeros((7, 7)), np.zeros(7), np.zeros(7)
    motion, v = motion_coefficients(vehicle), vehicle.speed_m_s
    a[BETA, BETA], a[BETA, R], a[R, BETA], a[R, R], steer[BETA], steer[R] = motion
    a[PSI, R], a[PSI, RHO] = 1.0, -v
    a[Y, BETA], a[Y, R], a[Y, PSI] = v, vehicle.preview_distance_m, v
    a[:, D] = steer
    if lag_s == 0.0:
        return a, steer
    a[:, DELTA] = steer
    a[DELTA, DELTA], b[DELTA] = -1.0 / lag_s, 1.0 / lag_s
    return a, b


def at_speed(vehicle: VehicleModelSettings, speed_m_s: float) -> NominalVehicle:
    """Return the vehicle at a speed."""
    return vehicle.vehicle._replace(speed_m_s=speed_m_s)
