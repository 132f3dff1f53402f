"""How old the newest accepted frame of each message is, beside the age limit of its message.

The limits are settings of [supervision]. What follows from a message that is stale:

    LATERAL_ERROR     HOLDING (``controller.modes``): there is nothing to steer by
    STEERING_STATUS   the delay is not known any more (``controller.link_memory``); laws that do
                      not need it go on, since LATERAL_ERROR closes the loop and not to steer any
                      more would be worse
    VEHICLE_STATE     as above, and its curvature and yaw rate are not those of now: what a law
                      makes of them fades out. Its speed, which changes slowly, stays in use
"""

from collections.abc import Mapping
from typing import NamedTuple

from dbc.messages import Freshness, LateralError, Message, SteeringStatus, VehicleState

NO_LIMIT_NS = 1 << 62
"""The age limit of a message that never goes stale."""


class AgeLimits(NamedTuple):
    """The age up to which a message is believed to tell of now [ns]."""

    lateral_error_ns: int
    steering_status_ns: int
    vehicle_state_ns: int


class Ages:
    """Keeps when a frame of each message was last accepted."""

    def __init__(self, limits: AgeLimits) -> None:
        self._limits_ns: Mapping[type[Message], int] = {
            LateralError: limits.lateral_error_ns,
            SteeringStatus: limits.steering_status_ns,
            VehicleState: limits.vehicle_state_ns,
        }
        self._arrival_ns: dict[type[Message], int] = {}

    def on_message(self, message_type: type[Message], now_ns: int) -> None:
        """Note that a frame was accepted."""
        self._arrival_ns[message_type] = now_ns

    def freshness(self, message_type: type[Message], now_ns: int) -> Freshness:
        """Return whether the newest frame is young enough."""
        arrival_ns = self._arrival_ns.get(message_type)
        if arrival_ns is None:
            return Freshness.NEVER_SEEN
        is_fresh = now_ns - arrival_ns <= self._limits_ns[message_type]
        return Freshness.FRESH if is_fresh else Freshness.STALE
