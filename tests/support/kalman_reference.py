"""The Kalman filter of ``prediction.vehicle_estimator`` in its reference form, by filterpy.

    x[k+1] = F x[k] + B u[k] + w[k],   E w wᵀ = Q        x = (β, r, Δψ, y, ρ, d, δ)
    z[k]   = H x[k] + v[k],            E v vᵀ = R        z = (y, Δψ)

Here the filter estimates all seven states, the wheel among them. Its gain is where its own predict
and update converge from covariances as large as the first metres of a run: a way to every number of
``VehicleGains`` that is independent of the Riccati equation. For tests and analysis only: filterpy
imports matplotlib and most of scipy, two thirds of a second that a live program must not spend.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from filterpy.kalman import KalmanFilter
from numpy.typing import NDArray

from steer_by_wire.controller.filters.settings import VehicleModelSettings
from steer_by_wire.controller.prediction.gains import (
    PSI,
    EstimatorSettings,
    Y,
    noise_covariances,
    sampled_vehicles,
)

Matrix = NDArray[np.float64]

MEASURED = (Y, PSI)
"""The states that a measurement shows, in its order."""
_INITIAL_DEVIATIONS = (0.1, 0.1, 0.1, 1.0, 0.1, 0.1, 0.0)
"""In the order of the state; the wheel is where the commands have put it."""
_STEPS_MAX = 1_000_000
_STEPS_PER_LOOK = 200
_SETTLED = 1e-12


class NotSettledError(ValueError):
    """The gain still moves after as many steps as anybody would wait for."""


def reference_filter(
    settings: EstimatorSettings,
    vehicle: VehicleModelSettings,
    speed_m_s: float,
    sensor_period_s: float,
) -> KalmanFilter:
    """Return filterpy's filter of the same model and noise, at the start of a run."""
    (f,), (g,) = sampled_vehicles(settings, vehicle, [speed_m_s], sensor_period_s)
    q, r = noise_covariances(settings, sensor_period_s)
    reference = KalmanFilter(dim_x=len(g), dim_z=len(MEASURED), dim_u=1)
    reference.F, reference.B = f, g[:, None]
    reference.H = np.eye(len(g))[list(MEASURED)]
    reference.Q = np.zeros_like(f)
    reference.Q[: len(q), : len(q)] = q
    reference.R = r
    reference.P = np.diag(np.square(_INITIAL_DEVIATIONS))
    return reference


def settled_gain(reference: KalmanFilter) -> Matrix:
    """Let the filter predict and update till its gain stands still; returns it, shape (7, 2).

    Raises NotSettledError where it does not.
    """
    for gain, after in pairwise(_gains(reference)):
        if float(np.abs(after - gain).max()) <= _SETTLED * float(np.abs(after).max()):
            return after
    raise NotSettledError(f"the gain still moves after {_STEPS_MAX} steps")


def settled_estimates(
    reference: KalmanFilter,
    gain: Matrix,
    state: Sequence[float],
    commands_rad: Sequence[float],
    measurements: Sequence[tuple[float, float] | None],
) -> Matrix:
    """Return the estimates at every sample of a record, shape (samples, 7), with a fixed gain.

    ``state``         at the sample before the first of the record
    ``commands_rad``  mean command up to each sample from the one before [rad]
    ``measurements``  lateral error [m] and heading error [rad] of each, None where it is lost
    """
    reference.x, reference.K = np.array(state, dtype=np.float64)[:, None], gain
    estimates = []
    for command_rad, measurement in zip(commands_rad, measurements, strict=True):
        reference.predict_steadystate(np.array([[command_rad]]))
        reference.update_steadystate(None if measurement is None else np.array(measurement))
        estimates.append(reference.x[:, 0].copy())
    return np.array(estimates)


def _gains(reference: KalmanFilter) -> Iterator[Matrix]:
    """Return the gain every so many steps; what is measured has no part in it."""
    nothing = np.zeros((len(MEASURED), 1))
    for _ in range(_STEPS_MAX // _STEPS_PER_LOOK):
        for _ in range(_STEPS_PER_LOOK):
            reference.predict()
            reference.update(nothing)
        yield np.array(reference.K)
