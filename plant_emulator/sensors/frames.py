"""The frames that carry the sensors' readings, clamped to the range of their signals."""

from collections.abc import Sequence
from math import remainder, tau

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
from ..vehicle.car.axle_use import AxleUse

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
