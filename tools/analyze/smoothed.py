"""Collects what the smoother needs of a log, and writes smoothed.csv: a row for every sample.

    time_s, side_slip_rad, ..., delay_s, steering_lag_s, and each with _std behind its name

The samples are those of LATERAL_ERROR and STEERING_STATUS, which share their counter. Their times
are those at which they came, evenly spread. The delay is from a command to the first echo of it.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...closed_loop.recordings.bus_listener import ReceivedMessage, command_at
from ...closed_loop.recordings.log_file import LogError
from ...controller.filters.settings import VehicleModelSettings
from ...controller.history.loop_delay import unwrapped
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
from .smoothing import (
    VEHICLE_STATES,
    Smoothed,
    smooth_delay,
    smooth_lag,
    smooth_vehicle,
)

COLUMNS = (*VEHICLE_STATES, "delay_s", "steering_lag_s")
_SAMPLES_MIN = 100


class _Error(NamedTuple):
    """A LATERAL_ERROR, and the number of its sample."""

    sample: int
    at_s: float
    lateral_error_m: float
    heading_error_rad: float


class _Status(NamedTuple):
    """A STEERING_STATUS; the command in effect is NaN where it is not known or not followed."""

    sample: int
    at_s: float
    wheel_rad: float
    command_rad: float


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
        self._commands: dict[int, tuple[float, SteeringCommand | SteeringPlan]] = {}
        """When each was sent [s], by its counter."""
        self._echoes: list[tuple[float, float]] = []
        """When a command was echoed first, and how long after it was sent [s]."""
        self._echoed = -1
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
            command_rad = self._on_echo(message, received.counter, at_s)
            self._statuses.append(_Status(sample, at_s, message.wheel_angle_rad, command_rad))
        elif isinstance(message, VehicleState):
            self._speeds_m_s.append(message.speed_m_s)
        elif isinstance(message, SteeringCommand | SteeringPlan):
            self._commands[command_at(message, 0).command_counter] = (at_s, message)

    def close(self) -> None:
        """Smooth and write; raises LogError."""
        samples = min(len(self._errors), len(self._statuses))
        speed_m_s = float(np.mean(self._speeds_m_s)) if self._speeds_m_s else 0.0
        if samples < _SAMPLES_MIN or not np.isfinite(self._errors[0].at_s) or speed_m_s <= 0.0:
            raise LogError(
                "--smooth needs a log with times, a speed above 0 in VEHICLE_STATE, and at least"
                f" {_SAMPLES_MIN} LATERAL_ERROR and STEERING_STATUS"
            )
        first, last = self._errors[0], self._errors[-1]
        period_s: float = (last.at_s - first.at_s) / (last.sample - first.sample)
        count = last.sample - first.sample + 1
        measured, wheel_rad, command_rad = self._by_sample(first.sample, count)
        time_s = first.at_s + period_s * np.arange(count, dtype=np.float64)
        states = smooth_vehicle(self._vehicle, speed_m_s, period_s, measured, wheel_rad)
        lag = smooth_lag(period_s, wheel_rad, command_rad)
        delay = self._delay_at(time_s)
        values = np.column_stack((states.values, delay.values, lag.values))
        deviations = np.column_stack((states.deviations, delay.deviations, lag.deviations))
        names = [name for column in COLUMNS for name in (column, f"{column}_std")]
        rows = np.column_stack((time_s, np.stack((values, deviations), axis=2).reshape(count, -1)))
        header = ",".join(("time_s", *names))
        np.savetxt(self._path, rows, "%.9g", ",", header=header, comments="")
        self.time_s, self.values, self.deviations = time_s, values, deviations
        means = zip(COLUMNS, values.mean(axis=0), deviations.mean(axis=0), strict=True)
        self.figures = {
            name: {"mean": float(mean), "mean_std": float(std)} for name, mean, std in means
        }

    def _by_sample(self, first: int, count: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return what was measured, the wheel and the command in effect at each sample."""
        measured, command_rad = np.full((count, 2), np.nan), np.full(count, np.nan)
        for error in self._errors:
            measured[error.sample - first] = error.lateral_error_m, error.heading_error_rad
        inside = [one for one in self._statuses if 0 <= one.sample - first < count]
        at = np.array([one.sample - first for one in inside])
        command_rad[at] = [one.command_rad for one in inside]
        # A lost wheel angle lies between its neighbours.
        wheel_rad = np.interp(np.arange(count), at, [one.wheel_rad for one in inside])
        return measured, wheel_rad, command_rad

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

    def _on_echo(self, status: SteeringStatus, counter: int, at_s: float) -> float:
        """Return the command in effect, and keep how long it took."""
        sent = self._commands.get(status.applied_counter)
        if sent is None or status.status is SteeringStatusCode.NO_COMMAND:
            return float("nan")
        sent_s, command = sent
        if status.applied_counter != self._echoed:
            self._echoed = status.applied_counter
            self._echoes.append((at_s, at_s - sent_s))
        if status.status is not SteeringStatusCode.APPLYING:
            return float("nan")
        return command_at(command, counter).steer_rad
