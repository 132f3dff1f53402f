"""Vehicle state and disturbance of a recording, smoothed: from all of it, with deviations.

The Kalman filter and the Rauch-Tung-Striebel smoother are filterpy's. The model is the vehicle
(β, r, Δψ, y, ρ, d) of ``controller.prediction.gains_over_speed`` at one speed, driven by the wheel
angle that the plant reports, seen by y and Δψ; d is a steering offset, which is also what a side
force or a bank look like.

The steering's lag is that of ``steer-by-wire identify``, apart from its dead time.

A value and its standard deviation are what the model makes of the record: a wrong vehicle is not in
the deviation.

The result is smoothed.csv, with a row for every sample of LATERAL_ERROR and STEERING_STATUS, which
share their counter, at the time at which it came, evenly spread:

    time_s, side_slip_rad, ..., and each with _std behind its name
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from filterpy.kalman import KalmanFilter
from matplotlib.figure import Figure

from ...closed_loop.identification.bus_series import BusSamples
from ...closed_loop.identification.figures import Verdict
from ...closed_loop.identification.steering import identify_steering
from ...closed_loop.recordings.log_analysis import LoggedMessages
from ...closed_loop.recordings.logged import LogError
from ...closed_loop.reports.page import Picture
from ...closed_loop.reports.plot_style import plot_style, png_of
from ...controller.filters.settings import VehicleModelSettings
from ...controller.prediction.gains_over_speed import (
    PSI,
    EstimatorSettings,
    Y,
    noise_covariances,
    sampled_vehicles,
)
from ...dbc import messages
from ...runtime.array_types import FloatArray
from .pictures import BLUE, WIDTH_IN

STATES = {
    "side_slip_rad": (0.1, "side slip [mrad]", 1e3),
    "yaw_rate_rad_s": (0.5, "yaw rate [mrad/s]", 1e3),
    "heading_error_rad": (0.5, "heading error [mrad]", 1e3),
    "lateral_error_m": (5.0, "preview point [mm]", 1e3),
    "curvature_1_m": (0.1, "curvature [1/km]", 1e3),
    "steering_offset_rad": (0.1, "steering offset [mrad]", 1e3),
}
"""Deviation before the first measurement, axis, and how many of its unit make the SI unit."""
VEHICLE_STATES = tuple(STATES)


class Smoothed(NamedTuple):
    """Values and their standard deviations, both of shape (samples, states)."""

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
    """
    settings, states = EstimatorSettings(), len(VEHICLE_STATES)
    model = sampled_vehicles(settings, vehicle, [speed_m_s], period_s)
    q, r = noise_covariances(settings, period_s)
    kalman = KalmanFilter(dim_x=states, dim_z=2, dim_u=1)
    kalman.F, kalman.B = model.f[0, :states, :states], model.g[0, :states, None]
    kalman.H, kalman.Q, kalman.R = np.eye(states)[[Y, PSI]], q, r
    kalman.P = np.diag([first**2 for first, _, _ in STATES.values()])
    # The filter predicts before it takes a measurement: the wheel on the way to each sample.
    before_rad = np.concatenate((wheel_rad[:1], wheel_rad[:-1]))
    mean_rad = 0.5 * (before_rad + wheel_rad)
    rows = [None if np.isnan(row).any() else row[:, None] for row in measured]
    means, covariances, _, _ = kalman.batch_filter(rows, us=mean_rad[:, None, None])
    # The smoother knows no input: it takes x - z, and z[k+1] = F z[k] + B u[k+1] is known.
    known = np.zeros_like(means)
    for index in range(1, len(known)):
        known[index] = kalman.F @ known[index - 1] + kalman.B * mean_rad[index]
    x, p, _, _ = kalman.rts_smoother(means - known, covariances)
    deviations = np.sqrt(np.maximum(np.diagonal(p, axis1=1, axis2=2), 0.0))
    return Smoothed((x + known)[:, :, 0], deviations)


_SAMPLES_MIN = 100


def delay_of(round_trip: Mapping[str, Any]) -> dict[str, Any]:
    """Return the mean of the round trips, which is the delay of the commands and of their echoes.

    Nothing where the log does not know it.
    """
    if not round_trip["interval"]:
        return {}
    return {"delay_s": _with_deviation(round_trip["mean_s"], *round_trip["interval"]["mean_s"])}


def _with_deviation(mean: float, low: float, high: float) -> dict[str, float]:
    """Return a mean, and its standard deviation by its interval of 95 %."""
    return {"mean": mean, "mean_std": (high - low) / 3.92}


class SmoothedTable:
    """Writes the table when it is closed; ``vehicle`` is the model, at the log's mean speed.

    Once it is closed:

    ``time_s``    of each sample since the first frame, shape (n,)
    ``smoothed``  the states at these times
    ``figures``   of each column and of ``steering_lag_s``, where the log knows it, the mean, and
                  that of its standard deviation
    """

    def __init__(self, path: Path, vehicle: VehicleModelSettings) -> None:
        self._path, self._vehicle, self._samples = path, vehicle, BusSamples()
        self.figures: dict[str, Any] = {}
        self.time_s, self.smoothed = np.empty(0), Smoothed(np.empty((0, 0)), np.empty((0, 0)))

    def write(self, taken: LoggedMessages) -> None:
        """Take the messages in a frame."""
        self._samples.write(taken)

    def close(self) -> None:
        """Smooth and write; raises LogError."""
        errors, statuses, states = (
            np.array(self._samples.rows[kind] or np.empty((0, 4)))
            for kind in (messages.LateralError, messages.SteeringStatus, messages.VehicleState)
        )
        speed_m_s = float(states[:, 2].mean()) if len(states) else 0.0
        samples = min(len(errors), len(statuses))
        if samples < _SAMPLES_MIN or not np.isfinite(errors[0, 1]) or speed_m_s <= 0.0:
            raise LogError(
                "--smooth needs a log with times, a speed above 0 in VEHICLE_STATE, and at least"
                f" {_SAMPLES_MIN} LATERAL_ERROR and STEERING_STATUS"
            )
        first, count = errors[0, 0], int(errors[-1, 0] - errors[0, 0]) + 1
        period_s = float(errors[-1, 1] - errors[0, 1]) / (count - 1)
        time_s = errors[0, 1] + period_s * np.arange(count, dtype=np.float64)
        measured, command_rad = np.full((count, 2), np.nan), np.full(count, np.nan)
        measured[(errors[:, 0] - first).astype(int)] = errors[:, 2:]
        places = (statuses[:, 0] - first).astype(int)
        is_within = (places >= 0) & (places < count)
        command_rad[places[is_within]] = statuses[is_within, 3]
        # A lost wheel angle lies between its neighbours.
        wheel_rad = np.interp(range(count), places, statuses[:, 2])
        found = smooth_vehicle(self._vehicle, speed_m_s, period_s, measured, wheel_rad)
        names = [name for state in VEHICLE_STATES for name in (state, f"{state}_std")]
        rows = np.column_stack((time_s, np.stack(found, axis=2).reshape(count, -1)))
        header = ",".join(("time_s", *names))
        np.savetxt(self._path, rows, "%.9g", ",", header=header, comments="")
        self.time_s, self.smoothed = time_s, found
        means = zip(VEHICLE_STATES, *(part.mean(axis=0) for part in found), strict=True)
        self.figures = {
            name: {"mean": float(mean), "mean_std": float(std)} for name, mean, std in means
        }
        steering = identify_steering(time_s, wheel_rad, command_rad)
        if steering is not None and steering.figures[0].verdict is not Verdict.NOT_IDENTIFIABLE:
            lag = steering.figures[0]
            self.figures["steering_lag_s"] = _with_deviation(lag.value, lag.low, lag.high)


def draw_smoothed(table: SmoothedTable) -> Picture:
    """Draw what the smoother found, each with a band of two standard deviations."""
    with plot_style():
        figure = Figure(figsize=(WIDTH_IN, 10.8))
        every = figure.subplots(len(STATES), 1, sharex=True)
        columns = zip(STATES.values(), *(part.T for part in table.smoothed), strict=True)
        for axes, ((_, label, scale), value, deviation) in zip(every, columns, strict=True):
            middle, half = scale * value, 2.0 * scale * deviation
            axes.plot(table.time_s, middle, color=BLUE, lw=1.0)
            low, high = axes.get_ylim()
            axes.fill_between(table.time_s, middle - half, middle + half, color=BLUE, alpha=0.25)
            # A band that is wide at the ends does not hide the line.
            margin = 2.0 * float(np.median(half))
            axes.set(ylabel=label, ylim=(low - margin, high + margin))
        every[-1].set_xlabel("time since the first frame [s]")
        return Picture(png_of(figure), "Smoothed: estimate and two standard deviations")
