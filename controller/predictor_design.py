"""Gains of filter and feedback of the predictor, for every speed.

The model is SAE 2018-01-1086 (1) with (2) corrected as in ``controller.nominal_model``, and with a
steering offset d and the wheel's lag T_a:

    β'  = a11 β + a12 r + b11 (δ + d)        Δψ' = r - V ρ              ρ' = noise
    r'  = a21 β + a22 r + b21 (δ + d)        y'  = V β + l_s r + V Δψ   d' = noise
    δ'  = (u - δ)/T_a,  or δ = u without a lag

sampled exactly for a held command. The filter is the one that has settled for white noise on β', r'
and the two random walks, and for the noise of the two measurements; the feedback costs least in
(k y)² + (u - u_ss)², k being the steer that a metre is worth. A table over speed, geometric steps,
linear in between.
"""

from bisect import bisect_right
from collections.abc import Sequence
from math import log
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from controller.estimator import VehicleGains
from controller.held_input import held_over
from controller.law_settings import EstimatorSettings, VehicleModelSettings
from controller.riccati import feedback_gain, filter_gain
from runtime.settings import SettingsError

Matrix = NDArray[np.float64]

BETA, R, PSI, Y, RHO, D, DELTA = range(7)
_SPEEDS_PER_DOUBLING = 8
_MEASURED = (Y, PSI)
_FREE = (BETA, R, PSI, Y)
_FILTERED = (BETA, R, PSI, Y, RHO, D)


class SampledVehicle(NamedTuple):
    """F, shape (7, 7), and G, shape (7,), over one period; states in the order β r Δψ y ρ d δ."""

    f: Matrix
    g: Matrix


class GainSchedule(NamedTuple):
    """Gains at rising speeds [m/s]."""

    speeds_m_s: Sequence[float]
    gains: Sequence[VehicleGains]

    def at(self, speed_m_s: float) -> VehicleGains:
        """Return the gains at a speed; beyond the table, those at its end."""
        after = bisect_right(self.speeds_m_s, speed_m_s)
        if after == 0:
            return self.gains[0]
        if after == len(self.speeds_m_s):
            return self.gains[-1]
        low, high = self.speeds_m_s[after - 1 : after + 1]
        part = (speed_m_s - low) / (high - low)
        pairs = zip(self.gains[after - 1], self.gains[after], strict=True)
        return VehicleGains(*(a + part * (b - a) for a, b in pairs))


def design_schedule(
    settings: EstimatorSettings,
    vehicle: VehicleModelSettings,
    period_s: float,
    sensor_period_s: float,
    steer_per_error_rad_m: float | None,
) -> GainSchedule:
    """Return the gains over the settings' range of speeds; ``period_s`` is the controller's.

    ``steer_per_error_rad_m``  the feedback's weight k; None for a filter without feedback

    Raises SettingsError where there are none, naming the speed.
    """
    low, high = settings.speed_m_s_min, settings.speed_m_s_max
    steps = max(1, round(_SPEEDS_PER_DOUBLING * log(high / low, 2.0)))
    speeds = [low * (high / low) ** (step / steps) for step in range(steps + 1)]
    gains = []
    for speed_m_s in speeds:
        try:
            gains.append(
                _gains(
                    settings, vehicle, speed_m_s, period_s, sensor_period_s, steer_per_error_rad_m
                )
            )
        except (ValueError, np.linalg.LinAlgError) as error:
            raise SettingsError(
                f"[estimator] has no gains at {speed_m_s:.4g} m/s: {error}; take noise and walks"
                " nearer to their defaults, or another range of speeds"
            ) from error
    return GainSchedule(speeds, gains)


def sampled_vehicle(
    settings: EstimatorSettings, vehicle: VehicleModelSettings, speed_m_s: float, period_s: float
) -> SampledVehicle:
    """Return the vehicle over a period of a held command."""
    a, b = _continuous(vehicle, speed_m_s, settings.actuator_lag_s)
    f, g = held_over(a, b, period_s)
    if settings.actuator_lag_s == 0.0:
        f[DELTA], f[:, DELTA], g[DELTA] = 0.0, 0.0, 1.0
    return SampledVehicle(f, g)


def noise_covariances(settings: EstimatorSettings, sensor_period_s: float) -> tuple[Matrix, Matrix]:
    """Return Q over a sensor period, order β r Δψ y ρ d, and R of (y, Δψ)."""
    densities = [
        settings.side_slip_noise_rad_sqrt_s,
        settings.yaw_rate_noise_rad_s_sqrt_s,
        0.0,
        0.0,
        settings.curvature_walk_1_m_sqrt_s,
        settings.steering_offset_walk_rad_sqrt_s,
    ]
    q = np.diag(np.square(densities)) * sensor_period_s
    r = np.diag(np.square([settings.lateral_error_noise_m, settings.heading_error_noise_rad]))
    return q, r


def _gains(
    settings: EstimatorSettings,
    vehicle: VehicleModelSettings,
    speed_m_s: float,
    period_s: float,
    sensor_period_s: float,
    steer_per_error_rad_m: float | None,
) -> VehicleGains:
    f, g = sampled_vehicle(settings, vehicle, speed_m_s, sensor_period_s)
    q, r = noise_covariances(settings, sensor_period_s)
    measured = np.eye(len(_FILTERED))[list(_MEASURED)]
    k = filter_gain(f[np.ix_(_FILTERED, _FILTERED)], measured, q, r)
    feedback: Sequence[float] = (0.0,) * 7
    if steer_per_error_rad_m is not None:
        feedback = _feedback(settings, vehicle, speed_m_s, period_s, steer_per_error_rad_m)
    columns = (BETA, R, D, DELTA)
    path = (BETA, R, RHO, D, DELTA)
    return VehicleGains(
        *map(
            float,
            (
                *(*f[BETA, columns], g[BETA]),
                *(*f[R, columns], g[R]),
                *(*f[PSI, path], g[PSI]),
                *(*f[Y, (BETA, R, PSI, RHO, D, DELTA)], g[Y]),
                *(f[DELTA, DELTA], g[DELTA]),
                *k.ravel(),
                *feedback,
            ),
        )
    )


def _feedback(
    settings: EstimatorSettings,
    vehicle: VehicleModelSettings,
    speed_m_s: float,
    period_s: float,
    steer_per_error_rad_m: float,
) -> Sequence[float]:
    """Return the feedback of β, r, Δψ, y and δ, and the feed-forward of ρ and d."""
    f, g = sampled_vehicle(settings, vehicle, speed_m_s, period_s)
    has_lag = settings.actuator_lag_s > 0.0
    states = [*_FREE, DELTA] if has_lag else list(_FREE)
    weight = np.zeros((len(states), len(states)))
    weight[Y, Y] = steer_per_error_rad_m**2
    k = feedback_gain(f[np.ix_(states, states)], g[states, None], weight, np.eye(1))[0]
    curvature = _steady_state(vehicle, speed_m_s)
    of_wheel = float(k[-1]) if has_lag else 0.0
    held = [*curvature[list(_FREE)], curvature[DELTA]][: len(states)]
    # u = u_ss - k (x - x_ss), and a steering offset is met by its opposite, wheel and all.
    by_curvature = curvature[DELTA] + k @ held
    return (*k[:4], of_wheel, by_curvature, -1.0 - of_wheel)


def _steady_state(vehicle: VehicleModelSettings, speed_m_s: float) -> Matrix:
    """Return the state that holds the vehicle on a path of curvature 1/m, in the order above."""
    a, b = _continuous(vehicle, speed_m_s, 0.0)
    unknown = (BETA, R, PSI, DELTA)
    equations = np.column_stack([a[:4][:, [BETA, R, PSI]], b[:4]])
    solution = np.linalg.solve(equations, -a[:4, RHO])
    state = np.zeros(7)
    state[list(unknown)] = solution
    state[RHO] = 1.0
    return state


def _continuous(
    vehicle: VehicleModelSettings, speed_m_s: float, lag_s: float
) -> tuple[Matrix, Matrix]:
    """Return the model in continuous time; without a lag, the wheel enters as the input."""
    v, m, j = speed_m_s, vehicle.virtual_mass_kg, vehicle.yaw_inertia_kg_m2
    c_f, c_r = vehicle.front_cornering_stiffness_n_rad, vehicle.rear_cornering_stiffness_n_rad
    l_f, l_r = vehicle.front_axle_distance_m, vehicle.rear_axle_distance_m
    a, b = np.zeros((7, 7)), np.zeros(7)
    a[BETA, BETA] = -(c_r + c_f) / (m * v)
    a[BETA, R] = -1.0 + (c_r * l_r - c_f * l_f) / (m * v**2)
    a[R, BETA] = (c_r * l_r - c_f * l_f) / j
    a[R, R] = -(c_r * l_r**2 + c_f * l_f**2) / (j * v)
    a[PSI, R], a[PSI, RHO] = 1.0, -v
    a[Y, BETA], a[Y, R], a[Y, PSI] = v, vehicle.preview_distance_m, v
    steer = np.zeros(7)
    steer[BETA], steer[R] = c_f / (m * v), c_f * l_f / j
    a[:, D] = steer
    if lag_s > 0.0:
        a[:, DELTA] = steer
        a[DELTA, DELTA] -= 1.0 / lag_s
        b[DELTA] = 1.0 / lag_s
    else:
        b = steer
    return a, b
