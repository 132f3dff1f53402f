"""Vehicle, disturbance, delay and lag of a recording, smoothed: from all of it, with deviations.

The Kalman filter and the Rauch-Tung-Striebel smoother are filterpy's; the models are

    vehicle  (β, r, Δψ, y, ρ, d) of ``controller.prediction.gains_over_speed`` at one speed, driven
             by the wheel angle that the plant reports, seen by y and Δψ; d is a steering offset,
             which is also what a side force or a bank look like
    delay    a random walk, seen by every echo: the time of a STEERING_STATUS less that of the
             command which it names

A value and its standard deviation are what the model makes of the record: a wrong vehicle, or a
network that changes faster than the random walk, is not in the deviation.

The result is smoothed.csv, with a row for every sample of LATERAL_ERROR and STEERING_STATUS, which
share their counter, at the time at which it came, evenly spread:

    time_s, side_slip_rad, ..., delay_s, and each with _std behind its name
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from filterpy.kalman import KalmanFilter

from ...closed_loop.recordings.bus_listener import ReceivedMessage, command_at
from ...closed_loop.recordings.log_file import LogError
from ...controller.filters.settings import VehicleModelSettings
from ...controller.history.echo_delay import unwrapped
from ...controller.prediction.gains_over_speed import (
    PSI,
    EstimatorSettings,
    Y,
    noise_covariances,
    sampled_vehicles,
)
from ...dbc.codec.protection import COUNTERS
from ...dbc.messages import (
    LateralError,
    SteeringCommand,
    SteeringPlan,
    SteeringStatus,
    SteeringStatusCode,
    VehicleState,
)
from ...runtime.array_types import FloatArray

VEHICLE_STATES = (
    "side_slip_rad",
    "yaw_rate_rad_s",
    "heading_error_rad",
    "lateral_error_m",
    "curvature_1_m",
    "steering_offset_rad",
)
_FIRST_DEVIATIONS = (0.1, 0.5, 0.5, 5.0, 0.1, 0.1)
"""Before the first measurement, in that order."""
DELAY_WALK_S_SQRT_S = 0.02
"""How far a delay goes in a second."""
_DELAY_NOISE_S_MIN = 5e-4


class Smoothed(NamedTuple):
    """Values and their standard deviations, both of shape (samples,) or (samples, states)."""

    values: FloatArray
    deviations: FloatArray


def smooth_vehicle(
    vehicle: VehicleModelSettings,
    speed_m_s: float,
    period_s: float,
    measured: FloatArray,
    wheel_rad: FloatArray,
) -> Smoothed:
    """Return the states of VEHICLE_STATES at every sample.

    ``measured``   lateral error [m] and heading error [rad], shape (samples, 2); NaN where lost
    ``wheel_rad``  of every sample
    """
    settings, states = EstimatorSettings(), len(VEHICLE_STATES)
    model = sampled_vehicles(settings, vehicle, [speed_m_s], period_s)
    q, r = noise_covariances(settings, period_s)
    kalman = KalmanFilter(dim_x=states, dim_z=2, dim_u=1)
    kalman.F, kalman.B = model.f[0, :states, :states], model.g[0, :states, None]
    kalman.H, kalman.Q, kalman.R = np.eye(states)[[Y, PSI]], q, r
    kalman.P = np.diag(np.square(_FIRST_DEVIATIONS))
    # The filter predicts before it takes a measurement: the wheel on the way to each sample.
    before_rad = np.concatenate((wheel_rad[:1], wheel_rad[:-1]))
    mean_rad = 0.5 * (before_rad + wheel_rad)
    rows = [None if np.isnan(row).any() else row[:, None] for row in measured]
    means, covariances = [], []
    for row, steer_rad in zip(rows, mean_rad, strict=True):
        kalman.predict(u=np.array([[steer_rad]]))
        kalman.update(row)
        means.append(kalman.x.copy())
        covariances.append(kalman.P.copy())
    return _smoothed_with_input(kalman, means, covariances, mean_rad)


def _smoothed_with_input(
    kalman: Any, means: list[FloatArray], covariances: list[FloatArray], inputs: FloatArray
) -> Smoothed:
    """Return the RTS smoother's states; filterpy's own knows no input, so its part is taken out.

    The part of the input, z[k+1] = F z[k] + B u[k+1], is known: the smoother takes x - z.
    """
    known = np.zeros((len(means), *kalman.x.shape))
    for index in range(1, len(means)):
        known[index] = kalman.F @ known[index - 1] + kalman.B * inputs[index]
    x, p, _, _ = kalman.rts_smoother(np.array(means) - known, np.array(covariances))
    deviations = np.sqrt(np.maximum(np.diagonal(p, axis1=1, axis2=2), 0.0))
    return Smoothed((x + known)[:, :, 0], deviations)


def smooth_delay(time_s: FloatArray, delay_s: FloatArray) -> Smoothed:
    """Return the delay at the times of the echoes [s]."""
    steps_s = np.diff(delay_s)
    noise_s = (
        max(_DELAY_NOISE_S_MIN, float(np.std(steps_s)) / np.sqrt(2.0)) if len(steps_s) else 1.0
    )
    kalman = KalmanFilter(dim_x=1, dim_z=1)
    kalman.F, kalman.H = np.eye(1), np.eye(1)
    kalman.x, kalman.P, kalman.R = delay_s[:1, None], np.eye(1), np.eye(1) * noise_s**2
    since_s = np.diff(time_s, prepend=time_s[:1])
    q = [np.eye(1) * DELAY_WALK_S_SQRT_S**2 * max(step_s, 1e-9) for step_s in since_s]
    means, covariances, _, _ = kalman.batch_filter(list(delay_s[:, None, None]), Qs=q)
    f = [kalman.F] * len(q)
    # filterpy's smoother takes the noise of the step from a sample at that sample's place.
    x, p, _, _ = kalman.rts_smoother(means, covariances, Fs=f, Qs=[*q[1:], q[-1]])
    return Smoothed(x[:, 0, 0], np.sqrt(p[:, 0, 0]))


COLUMNS = (*VEHICLE_STATES, "delay_s")
_SAMPLES_MIN = 100


class _Error(NamedTuple):
    """A LATERAL_ERROR, and the number of its sample."""

    sample: int
    at_s: float
    lateral_error_m: float
    heading_error_rad: float


class _Status(NamedTuple):
    """A STEERING_STATUS, and the number of its sample."""

    sample: int
    wheel_rad: float


class SmoothedTable:
    """Writes the table when it is closed; ``vehicle`` is the model, at the log's mean speed.

    Once it is closed:

    ``time_s``      of each sample since the first frame, shape (n,)
    ``values``      of COLUMNS, shape (n, columns), and their standard ``deviations``
    ``figures``     of each column the mean, and that of its standard deviation
    """

    def __init__(self, path: Path, vehicle: VehicleModelSettings) -> None:
        self._path, self._vehicle = path, vehicle
        self._errors: list[_Error] = []
        self._statuses: list[_Status] = []
        self._speeds_m_s: list[float] = []
        self._sent_s: dict[int, float] = {}
        """When each was sent [s], by its counter."""
        self._echoes: list[tuple[float, float]] = []
        """When a command was echoed first, and how long after it was sent [s]."""
        self.figures: dict[str, Any] = {}
        self.time_s, self.values, self.deviations = np.empty(0), np.empty((0, 0)), np.empty((0, 0))

    def write(self, time_ns: int | None, at_s: float, received: ReceivedMessage) -> None:  # noqa: ARG002
        """Take a message."""
        message = received.message
        if received.is_late:
            return
        if isinstance(message, LateralError):
            sample = self._sample(self._errors, received.counter)
            self._errors.append(_Error(sample, at_s, *message))
        elif isinstance(message, SteeringStatus):
            sample = self._sample(self._statuses, received.counter)
            self._statuses.append(_Status(sample, message.wheel_angle_rad))
            self._on_echo(message, at_s)
        elif isinstance(message, VehicleState):
            self._speeds_m_s.append(message.speed_m_s)
        elif isinstance(message, SteeringCommand | SteeringPlan):
            self._sent_s[command_at(message, 0).command_counter] = at_s

    def close(self) -> None:
        """Smooth and write; raises LogError."""
        samples = min(len(self._errors), len(self._statuses))
        speed_m_s = float(np.mean(self._speeds_m_s or [0.0]))
        if samples < _SAMPLES_MIN or not np.isfinite(self._errors[0].at_s) or speed_m_s <= 0.0:
            raise LogError(
                "--smooth needs a log with times, a speed above 0 in VEHICLE_STATE, and at least"
                f" {_SAMPLES_MIN} LATERAL_ERROR and STEERING_STATUS"
            )
        first, last = self._errors[0], self._errors[-1]
        period_s: float = (last.at_s - first.at_s) / (last.sample - first.sample)
        count = last.sample - first.sample + 1
        measured, wheel_rad = self._by_sample(first.sample, count)
        time_s = first.at_s + period_s * np.arange(count, dtype=np.float64)
        states = smooth_vehicle(self._vehicle, speed_m_s, period_s, measured, wheel_rad)
        delay = self._delay_at(time_s)
        values = np.column_stack((states.values, delay.values))
        deviations = np.column_stack((states.deviations, delay.deviations))
        names = [name for column in COLUMNS for name in (column, f"{column}_std")]
        rows = np.column_stack((time_s, np.stack((values, deviations), axis=2).reshape(count, -1)))
        header = ",".join(("time_s", *names))
        np.savetxt(self._path, rows, "%.9g", ",", header=header, comments="")
        self.time_s, self.values, self.deviations = time_s, values, deviations
        means = zip(COLUMNS, values.mean(axis=0), deviations.mean(axis=0), strict=True)
        self.figures = {
            name: {"mean": float(mean), "mean_std": float(std)} for name, mean, std in means
        }

    def _by_sample(self, first: int, count: int) -> tuple[FloatArray, FloatArray]:
        """Return what was measured at each sample, and the wheel."""
        measured = np.full((count, 2), np.nan)
        for error in self._errors:
            measured[error.sample - first] = error.lateral_error_m, error.heading_error_rad
        at = [one.sample - first for one in self._statuses]
        # A lost wheel angle lies between its neighbours.
        return measured, np.interp(range(count), at, [one.wheel_rad for one in self._statuses])

    def _delay_at(self, time_s: FloatArray) -> Smoothed:
        """Return the delay at each sample; NaN where no command was ever echoed."""
        if not self._echoes:
            return Smoothed(np.full(len(time_s), np.nan), np.full(len(time_s), np.nan))
        at_s, delay_s = np.array(self._echoes).T
        smoothed = smooth_delay(at_s, delay_s)
        return Smoothed(*(np.interp(time_s, at_s, column) for column in smoothed))

    def _sample(self, own: Sequence[_Error | _Status], counter: int) -> int:
        """Return the number of a sample: the one nearest to what comes next."""
        other = self._statuses if own is self._errors else self._errors
        if own:
            return unwrapped(counter, own[-1].sample + 1, COUNTERS)
        return unwrapped(counter, other[-1].sample, COUNTERS) if other else counter

    def _on_echo(self, status: SteeringStatus, at_s: float) -> None:
        """Keep how long a command took that is echoed for the first time."""
        sent_s = self._sent_s.pop(status.applied_counter, None)
        if sent_s is not None and status.status is not SteeringStatusCode.NO_COMMAND:
            self._echoes.append((at_s, at_s - sent_s))
