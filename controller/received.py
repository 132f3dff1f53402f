"""What the controller has received: the newest of each message, and whether it is of now.

When a frame arrived is kept once, by the check of its message's counters. The mode table, the law,
the watch on the delay and CONTROLLER_SAFETY all go by that.
"""

from ..dbc.messages import Freshness, LateralError, Message, Rejection, SteeringStatus, VehicleState
from ..dbc.protection import SequenceResult
from ..dbc.reception import Reception
from ..dbc.secured_frame import Refused
from ..runtime.frame import Frame
from ..runtime.record import new_record
from .freshness import freshness
from .law_interface import NO_VEHICLE, VehicleReading
from .settings import ControllerSettings, age_limits_of, resync_ns_of

RECEIVED: tuple[type[Message], ...] = (LateralError, SteeringStatus, VehicleState)
"""What the controller receives."""


class Received:
    """Judges frames and keeps what they say.

    ``errors``, ``statuses``, ``states``  counter and arrival of the newest frame of each message
    ``lateral_error_m``, ``vehicle``      the newest values; 0 and NO_VEHICLE before the first
    ``unauthenticated``                   frames refused before they came here
    """

    def __init__(self, settings: ControllerSettings) -> None:
        table = settings.supervision
        self.reception = Reception(
            RECEIVED, table.max_counter_jump, table.recovery_frames, resync_ns_of(settings)
        )
        self.errors, self.statuses, self.states = map(self.reception.newest, RECEIVED)
        self._limits = age_limits_of(settings)
        self.lateral_error_m = 0.0
        self.vehicle = NO_VEHICLE
        self.unauthenticated = 0

    @property
    def refused(self) -> int:
        """Frames refused so far, whatever the cause."""
        return self.reception.refused + self.unauthenticated

    def take(
        self, frame: Frame, now_ns: int
    ) -> Message | Rejection | SequenceResult | Refused | None:
        """Judge a frame, and keep what it says; returns what ``Reception.take`` does."""
        message = self.reception.take(frame, now_ns)
        if isinstance(message, LateralError):
            self.lateral_error_m = message.lateral_error_m
        elif isinstance(message, VehicleState):
            self.vehicle = new_record(VehicleReading, (*message, False))
        return message

    def vehicle_at(self, now_ns: int) -> VehicleReading:
        """Return the newest motion of the vehicle, marked where it is not of now."""
        arrival_ns = self.states.arrival_ns
        if arrival_ns is not None and now_ns - arrival_ns > self._limits.vehicle_state_ns:
            return self.vehicle._replace(is_stale=True)
        return self.vehicle

    def freshness(self, now_ns: int) -> tuple[Freshness, Freshness, Freshness]:
        """Return how old the newest of each of RECEIVED is."""
        limits = self._limits
        return (
            freshness(self.errors.arrival_ns, limits.lateral_error_ns, now_ns),
            freshness(self.statuses.arrival_ns, limits.steering_status_ns, now_ns),
            freshness(self.states.arrival_ns, limits.vehicle_state_ns, now_ns),
        )

    def fresh_until_ns(self) -> int:
        """Return until when all of RECEIVED, which are fresh now, stay so if none comes [ns]."""
        checks = (self.errors, self.statuses, self.states)
        return min(
            (check.arrival_ns or 0) + limit_ns
            for check, limit_ns in zip(checks, self._limits, strict=True)
        )
