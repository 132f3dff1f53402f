"""What the sensors send: LATERAL_ERROR and STEERING_STATUS at every sample, the others at some."""

from ...dbc.messages import (
    CAN_IDS,
    LateralError,
    PathAhead,
    SteeringStatus,
    SteeringStatusCode,
    VehicleState,
)
from ...runtime.frame import Frame
from ...runtime.node import NS_PER_S
from ...runtime.node.periodic import PeriodicTimer
from ..network.latency_line import LatencyLine
from ..network.random_streams import Channel, uniforms
from ..settings import PlantSettings
from ..vehicle.motion import Motion
from .messages import PlantMessages
from .path_ahead import curvatures_ahead_1_m, spacing_m
from .sensors import Readings, with_noise

VEHICLE_STATE_PERIOD_NS = 20_000_000
_ERROR_ID, _STATUS_ID = CAN_IDS[LateralError], CAN_IDS[SteeringStatus]
_STATE_ID, _PATH_ID = CAN_IDS[VehicleState], CAN_IDS[PathAhead]


def samples_per_vehicle_state(sensor_period_ns: int) -> int:
    """Return the number of samples from one VEHICLE_STATE to the next."""
    return max(1, VEHICLE_STATE_PERIOD_NS // sensor_period_ns)


class Sampling:
    """Puts the messages of each sample into the ``uplink``; ``start_ns`` is the first [ns]."""

    def __init__(
        self,
        settings: PlantSettings,
        start_ns: int,
        messages: PlantMessages,
        uplink: LatencyLine[Frame],
    ) -> None:
        every = samples_per_vehicle_state(settings.sensor_period_ns)
        self._state_timer = PeriodicTimer(start_ns, every * settings.sensor_period_ns)
        ahead = settings.path_ahead
        self._ahead_m = (
            None if ahead is None else spacing_m(settings.vehicle.speed_m_s, ahead.reach_s)
        )
        noise = settings.sensor_noise
        deviations = Readings(noise.lateral_error_m, noise.heading_error_rad, noise.yaw_rate_rad_s)
        self._noise = deviations if any(deviations) else None
        self._uniforms = uniforms(settings.seed, Channel.SENSOR_NOISE)
        self._messages, self._uplink = messages, uplink

    def send(
        self,
        motion: Motion,
        applied: int,
        code: SteeringStatusCode,
        time_ns: int,
        motion_ns: int,
    ) -> None:
        """Sample the motion at ``time_ns``.

        ``applied``    counter of the command in effect
        ``code``       of the steering
        ``motion_ns``  time since the start of motion [ns]
        """
        messages = self._messages
        z = motion.linear
        _, yaw_rate_rad_s, heading_rad, error_m, wheel_rad, _, curvature_1_m, _, _, _ = z
        if self._noise is not None:
            true = error_m, heading_rad, yaw_rate_rad_s
            error_m, heading_rad, yaw_rate_rad_s = with_noise(true, self._noise, self._uniforms)
        error = messages.lateral_error(error_m, heading_rad, is_finite=motion.is_finite)
        status = messages.steering_status(wheel_rad, applied, code)
        frames = [(_ERROR_ID, error), (_STATUS_ID, status)]
        if time_ns >= self._state_timer.deadline_ns:  # also after a skipped sample
            self._state_timer.advance(time_ns)
            state = messages.vehicle_state(motion.speed_m_s, yaw_rate_rad_s, curvature_1_m)
            frames.append((_STATE_ID, state))
            if self._ahead_m is not None:
                at_m = motion.speed_m_s * (motion_ns / NS_PER_S)
                ahead_1_m = curvatures_ahead_1_m(motion.path, at_m, self._ahead_m)
                frames.append((_PATH_ID, messages.path_ahead(self._ahead_m, ahead_1_m)))
        self._uplink.push(frames, time_ns, motion_ns)
