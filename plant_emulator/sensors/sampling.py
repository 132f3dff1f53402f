"""Messages of a sample: LATERAL_ERROR and STEERING_STATUS always, the others at some.

Sensor noise is white, Gaussian and additive, one number per quantity and sample:

    measured = true + standard deviation · Φ⁻¹(u),   u uniform in (0, 1)

Every sample takes three uniforms, whatever the deviations, so that switching one noise on does not
change the others. With a deviation of 0 the true value passes unchanged.
"""

from collections.abc import Iterator
from statistics import NormalDist
from typing import NamedTuple

from ...dbc.messages import (
    CAN_IDS,
    LateralError,
    PathAhead,
    SteeringStatus,
    SteeringStatusCode,
    VehicleState,
)
from ...runtime.frame import Frame
from ...runtime.node.periodic import PeriodicTimer
from ..network.latency_line import LatencyLine
from ..network.random_streams import Stream, uniforms
from ..vehicle.moving_vehicle import Motion
from .frames import SensorFrames
from .path_ahead import curvatures_ahead_1_m, spacing_m
from .settings import PathAheadSettings, SensorNoiseSettings

VEHICLE_STATE_PERIOD_NS = 20_000_000
_ERROR_ID, _STATUS_ID = CAN_IDS[LateralError], CAN_IDS[SteeringStatus]
_STATE_ID, _PATH_ID = CAN_IDS[VehicleState], CAN_IDS[PathAhead]
_STANDARD_NORMAL = NormalDist()


class Readings(NamedTuple):
    """One sample of the quantities measured with noise."""

    lateral_error_m: float
    heading_error_rad: float
    yaw_rate_rad_s: float


Sample = tuple[float, float, float]
"""The values of ``Readings``."""


def with_noise(true: Sample, deviation: Readings, uniforms: Iterator[float]) -> Sample:
    """Return the sample with noise; takes three uniforms in (0, 1)."""
    normal = _STANDARD_NORMAL.inv_cdf
    error_m, heading_rad, yaw_rate_rad_s = true
    return (
        error_m + deviation.lateral_error_m * normal(next(uniforms)),
        heading_rad + deviation.heading_error_rad * normal(next(uniforms)),
        yaw_rate_rad_s + deviation.yaw_rate_rad_s * normal(next(uniforms)),
    )


def samples_per_vehicle_state(sensor_period_ns: int) -> int:
    """Return the number of samples from one VEHICLE_STATE to the next."""
    return max(1, VEHICLE_STATE_PERIOD_NS // sensor_period_ns)


class Sampling:
    """Puts the frames of each sample into the ``uplink``.

    ``ahead``      whether and how far PATH_AHEAD is sent, for the speed ``nominal_m_s``
    ``start_ns``   first sample, and ``period_ns`` from one to the next [ns]
    """

    def __init__(
        self,
        motion: Motion,
        noise: SensorNoiseSettings,
        ahead: PathAheadSettings | None,
        nominal_m_s: float,
        seed: int,
        start_ns: int,
        period_ns: int,
        uplink: LatencyLine[Frame],
    ) -> None:
        every = samples_per_vehicle_state(period_ns)
        self._state_timer = PeriodicTimer(start_ns, every * period_ns)
        self._ahead_m = None if ahead is None else spacing_m(nominal_m_s, ahead.reach_s)
        deviations = Readings(noise.lateral_error_m, noise.heading_error_rad, noise.yaw_rate_rad_s)
        self._noise = deviations if any(deviations) else None
        self._uniforms = uniforms(seed, Stream.SENSOR_NOISE)
        self.frames = SensorFrames()
        self._motion, self._uplink = motion, uplink

    def send(self, applied: int, code: SteeringStatusCode, time_ns: int, motion_ns: int) -> None:
        """Sample the motion at ``time_ns``.

        ``applied``    counter of the command in effect
        ``code``       of the steering
        ``motion_ns``  time since the start of motion [ns]
        """
        motion, made = self._motion, self.frames
        z = motion.linear
        _, yaw_rate_rad_s, heading_rad, error_m, wheel_rad, _, curvature_1_m, _, _, _ = z
        if self._noise is not None:
            true = error_m, heading_rad, yaw_rate_rad_s
            error_m, heading_rad, yaw_rate_rad_s = with_noise(true, self._noise, self._uniforms)
        error = made.lateral_error(error_m, heading_rad, motion.is_finite)
        status = made.steering_status(wheel_rad, applied, code)
        frames = [(_ERROR_ID, error), (_STATUS_ID, status)]
        if time_ns >= self._state_timer.deadline_ns:  # also after a skipped sample
            self._state_timer.advance(time_ns)
            at_m, speed_m_s = motion.place
            state = made.vehicle_state(speed_m_s, yaw_rate_rad_s, curvature_1_m)
            frames.append((_STATE_ID, state))
            if self._ahead_m is not None:
                ahead_1_m = curvatures_ahead_1_m(motion.path, at_m, self._ahead_m)
                frames.append((_PATH_ID, made.path_ahead(self._ahead_m, ahead_1_m)))
        self._uplink.push(frames, time_ns, motion_ns)
