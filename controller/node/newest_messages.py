"""The newest received value of each message, and whether it is fresh.

The arrival time of a frame is stored once, by the check of its message's counters. The mode table,
the law, the reported delay and CONTROLLER_SAFETY all use it.
"""

from ...dbc.messages import (
    Freshness,
    HandWheelState,
    LateralError,
    Message,
    PathAhead,
    SteeringStatus,
    SteeringStatusCode,
    VehicleState,
    sent_by,
)
from ...dbc.reception import Reception
from ...runtime.fast_named_tuple import fast_constructor
from ..age_limits import freshness
from ..law_interface import NO_VEHICLE, VehicleReading
from ..settings import ControllerSettings

SUPERVISED: tuple[type[Message], ...] = (LateralError, SteeringStatus, VehicleState)
"""The messages without which the controller falls back."""
_NAMES = ("LATERAL_ERROR", "STEERING_STATUS", "VEHICLE_STATE")
RECEIVED: tuple[type[Message], ...] = (*SUPERVISED, PathAhead)
"""The messages that the controller receives."""
_reading = fast_constructor(VehicleReading)
_APPLYING, _HOLDING = SteeringStatusCode.APPLYING, SteeringStatusCode.HOLDING
NO_STATUS = SteeringStatus._make(0 for _ in SteeringStatus._fields)._replace(
    wheel_angle_rad=0.0, status=SteeringStatusCode.NO_COMMAND
)
"""What stands for STEERING_STATUS before the first one."""
SENT = sent_by("CONTROLLER")
"""The messages that the controller alone sends."""
WHEN_LOST = "waiting for it until Ctrl-C (--exit-with-plant ends by itself)"
"""What the controller does by default."""
WHEN_ENDING = "ending when the command is back at zero"


def acting_rad(
    code: SteeringStatusCode, age: Freshness, wheel_rad: float, sent_rad: float
) -> float:
    """Return the command that acts: the one sent, or the wheel's angle in its place.

    An observer that takes a command for the vehicle's input which the steering limits, or no longer
    follows, winds up. One that is held is a late command, as in any network.

    ``code``, ``age``  of the newest STEERING_STATUS
    """
    is_other = code >= SteeringStatusCode.LIMITED_BY_SAFETY and code is not _HOLDING
    return wheel_rad if is_other and age is Freshness.FRESH else sent_rad


def plant_text(freshness: tuple[Freshness, ...], *, ends_with_plant: bool) -> str:
    """Return which messages of the plant have stopped."""
    stale = [name for name, age in zip(_NAMES, freshness, strict=True) if age is Freshness.STALE]
    if len(stale) == len(_NAMES):
        then = WHEN_ENDING if ends_with_plant else WHEN_LOST
        return f"plant lost: all its messages have stopped; {then}"
    if stale:
        return f"plant: {' and '.join(stale)} stopped"
    return "plant present" if Freshness.FRESH in freshness else ""


class Received:
    """Checks frames and keeps the newest values.

    ``errors``, ``statuses``, ``states``  counter and arrival of the newest frame of each message
    ``error``, ``status``, ``vehicle``    the newest values; 0, NO_COMMAND and NO_VEHICLE before the
                                          first
    """

    def __init__(self, settings: ControllerSettings) -> None:
        received = RECEIVED if settings.hand_wheel is None else (*RECEIVED, HandWheelState)
        self.reception = Reception(received, settings.counters, SENT)
        self._checks = tuple(map(self.reception.newest, SUPERVISED))
        self.errors, self.statuses, self.states = self._checks
        self._limits = settings.age_limits
        self.error = LateralError(lateral_error_m=0.0, heading_error_rad=0.0)
        self.status = NO_STATUS
        self.vehicle = NO_VEHICLE
        self.unauthenticated = 0

    def on_motion(self, message: VehicleState) -> None:
        """Store how the vehicle moves."""
        self.vehicle = _reading(
            speed_m_s=message.speed_m_s,
            yaw_rate_rad_s=message.yaw_rate_rad_s,
            preview_curvature_1_m=message.preview_curvature_1_m,
        )

    def on_unauthenticated(self) -> None:
        """Count a frame that authentication has refused."""
        self.unauthenticated += 1

    @property
    def refused(self) -> int:
        """Frames refused so far, for any cause."""
        return self.reception.refused + self.unauthenticated

    def read_by_law(self, sent_rad: float, now_ns: int) -> tuple[float, float, VehicleReading]:
        """Return lateral error, the command that acts, and the motion, marked if it is stale.

        ``sent_rad``  the command sent in the period before
        """
        status, vehicle, limits = self.status, self.vehicle, self._limits
        code, arrival_ns = status.status, self.states.arrival_ns
        if arrival_ns is not None and now_ns - arrival_ns > limits.vehicle_state_ns:
            vehicle = vehicle._replace(is_stale=True)
        if code is not _APPLYING:
            age = freshness(self.statuses.arrival_ns, limits.steering_status_ns, now_ns)
            sent_rad = acting_rad(code, age, status.wheel_angle_rad, sent_rad)
        return self.error.lateral_error_m, sent_rad, vehicle

    def freshness(self, now_ns: int) -> tuple[Freshness, Freshness, Freshness]:
        """Return the freshness of each message of SUPERVISED."""
        limits = self._limits
        return (
            freshness(self.errors.arrival_ns, limits.lateral_error_ns, now_ns),
            freshness(self.statuses.arrival_ns, limits.steering_status_ns, now_ns),
            freshness(self.states.arrival_ns, limits.vehicle_state_ns, now_ns),
        )

    def silence_ns(self, now_ns: int) -> int:
        """Return the time since the newest message of the plant; 0 before the first [ns]."""
        arrivals_ns = (check.arrival_ns for check in self._checks)
        return now_ns - max((each for each in arrivals_ns if each is not None), default=now_ns)

    def fresh_until_ns(self) -> int:
        """Return until when all of SUPERVISED, fresh now, stay fresh without new frames [ns]."""
        pairs = zip(self._checks, self._limits, strict=True)
        return min((check.arrival_ns or 0) + limit_ns for check, limit_ns in pairs)
