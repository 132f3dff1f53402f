"""Messages of a sample: LATERAL_ERROR and STEERING_STATUS always, the others at some.

Sensor noise is white, Gaussian and additive, one number per quantity and sample:

    measured = true + standard deviation · Φ⁻¹(u),   u uniform in (0, 1)

Every sample takes three uniforms, whatever the deviations, so that switching one noise on does not
change the others. With a deviation of 0 the true value passes unchanged.
"""

from collections.abc import Iterator, Sequence
from math import remainder, tau
from statistics import NormalDist

from ...dbc.codec.protection import COUNTERS
from ...dbc.messages import (
    CURVATURE_FIELDS,
    CarTruth,
    GroundTruth,
    LateralError,
    PathAhead,
    Sender,
    SignalRange,
    SteeringForce,
    SteeringStatus,
    SteeringStatusCode,
    VehicleState,
    limits,
)
from ...runtime.fast_named_tuple import field_values
from ...runtime.frame import Frame
from ...runtime.node.periodic import PeriodicTimer
from ..network.latency_line import LatencyLine
from ..network.random_streams import Stream, uniforms
from ..vehicle.car.axle_use import AxleUse
from ..vehicle.moving_vehicle import Motion
from .path_ahead import curvatures_ahead_1_m, spacing_m
from .settings import PathAheadSettings, SensorNoiseSettings

_ERROR_LOW_M, _ERROR_HIGH_M = limits(LateralError)["lateral_error_m"]
_WHEEL_RANGE = limits(SteeringStatus)["wheel_angle_rad"]
_WHEEL_LOW_RAD, _WHEEL_HIGH_RAD = _WHEEL_RANGE
_SPEED_RANGE = limits(VehicleState)["speed_m_s"]
_YAW_RATE_RANGE = limits(VehicleState)["yaw_rate_rad_s"]
_CURVATURE_RANGE = limits(VehicleState)["preview_curvature_1_m"]
_COMMAND_RANGE = limits(SteeringForce)["limited_command_rad"]
_FORCE_RANGE = limits(SteeringForce)["rack_force_n"]
_USE_RANGES = limits(CarTruth)
_CG_RANGE = limits(GroundTruth)["cg_deviation_m"]
_error, _status = field_values(LateralError), field_values(SteeringStatus)
_state = field_values(VehicleState)
_NO_ERROR = LateralError(lateral_error_m=0.0, heading_error_rad=0.0)


class SensorFrames:
    """Makes the frames; each message has its own counter.

    ``not_available``  samples beyond the range of LATERAL_ERROR, sent as NOT_AVAILABLE
    ``clamped``        other values sent as the end of their signal's range
    """

    def __init__(self) -> None:
        self._errors, self._statuses = Sender(LateralError), Sender(SteeringStatus)
        self._states, self._forces = Sender(VehicleState), Sender(SteeringForce)
        self._paths, self._truths = Sender(PathAhead), Sender(GroundTruth)
        self._car_truths = Sender(CarTruth)
        self.not_available = 0
        self.clamped = 0

    @property
    def next_sample(self) -> int:
        """E2E counter of the next LATERAL_ERROR, the number of its sample on the wire."""
        return self._errors.counter

    def lateral_error(self, error_m: float, heading_rad: float, is_finite: bool) -> Frame:
        """Return LATERAL_ERROR; NOT_AVAILABLE too far from the path."""
        if is_finite and _ERROR_LOW_M <= error_m <= _ERROR_HIGH_M:
            # The sensor reports an angle within one turn.
            turned_rad = remainder(heading_rad, tau)
            return self._errors.frame(_error(lateral_error_m=error_m, heading_error_rad=turned_rad))
        self.not_available += 1
        return self._errors.not_available(_NO_ERROR)

    def steering_status(self, wheel_rad: float, applied: int, code: SteeringStatusCode) -> Frame:
        """Return STEERING_STATUS; ``applied`` is the counter of the command in effect."""
        if not _WHEEL_LOW_RAD <= wheel_rad <= _WHEEL_HIGH_RAD:
            wheel_rad = self._clamp(wheel_rad, _WHEEL_RANGE)
        return self._statuses.frame(
            _status(wheel_angle_rad=wheel_rad, applied_counter=applied, status=code)
        )

    def vehicle_state(self, speed_m_s: float, yaw_rate_rad_s: float, curvature_1_m: float) -> Frame:
        """Return VEHICLE_STATE."""
        state = _state(
            speed_m_s=self._clamp(speed_m_s, _SPEED_RANGE),
            yaw_rate_rad_s=self._clamp(yaw_rate_rad_s, _YAW_RATE_RANGE),
            preview_curvature_1_m=self._clamp(curvature_1_m, _CURVATURE_RANGE),
        )
        return self._states.frame(state)

    def steering_force(self, command_rad: float, rack_force_n: float) -> Frame:
        """Return STEERING_FORCE; the command is that after the limits."""
        force = SteeringForce(
            limited_command_rad=self._clamp(command_rad, _COMMAND_RANGE),
            rack_force_n=self._clamp(rack_force_n, _FORCE_RANGE),
        )
        return self._forces.frame(force)

    def ground_truth(self, cg_m: float) -> Frame:
        """Return GROUND_TRUTH; ``cg_m`` is the deviation of the centre of gravity."""
        return self._truths.frame(GroundTruth(cg_deviation_m=self._clamp(cg_m, _CG_RANGE)))

    def car_truth(self, use: AxleUse) -> Frame:
        """Return CAR_TRUTH."""
        values = {
            name: self._clamp(value, _USE_RANGES[name]) for name, value in use._asdict().items()
        }
        return self._car_truths.frame(CarTruth(**values))

    def path_ahead(self, spacing_m: float, curvatures_1_m: Sequence[float]) -> Frame:
        """Return PATH_AHEAD of the sample whose LATERAL_ERROR was made last."""
        sample = (self.next_sample - 1) % COUNTERS
        values = dict(zip(CURVATURE_FIELDS, curvatures_1_m, strict=True))
        return self._paths.frame(PathAhead(path_sample=sample, path_spacing_m=spacing_m, **values))

    def _clamp(self, value: float, allowed: SignalRange) -> float:
        low, high = allowed
        if low <= value <= high:
            return value
        self.clamped += 1
        return low if value < low else high


VEHICLE_STATE_PERIOD_NS = 20_000_000
_STANDARD_NORMAL = NormalDist()


Sample = tuple[float, float, float]
"""What is measured with noise: lateral error [m], heading error [rad], yaw rate [rad/s]."""


def with_noise(true: Sample, deviation: Sample, uniforms: Iterator[float]) -> Sample:
    """Return the sample with noise; takes three uniforms in (0, 1)."""
    normal = _STANDARD_NORMAL.inv_cdf
    error_m, heading_rad, yaw_rate_rad_s = true
    by_error_m, by_heading_rad, by_yaw_rate_rad_s = deviation
    return (
        error_m + by_error_m * normal(next(uniforms)),
        heading_rad + by_heading_rad * normal(next(uniforms)),
        yaw_rate_rad_s + by_yaw_rate_rad_s * normal(next(uniforms)),
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
        deviations = noise.lateral_error_m, noise.heading_error_rad, noise.yaw_rate_rad_s
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
        frames = [error, status]
        if time_ns >= self._state_timer.deadline_ns:  # also after a skipped sample
            self._state_timer.advance(time_ns)
            at_m, speed_m_s = motion.place
            state = made.vehicle_state(speed_m_s, yaw_rate_rad_s, curvature_1_m)
            frames.append(state)
            if self._ahead_m is not None:
                ahead_1_m = curvatures_ahead_1_m(motion.path, at_m, self._ahead_m)
                frames.append(made.path_ahead(self._ahead_m, ahead_1_m))
        self._uplink.push(frames, time_ns, motion_ns)
