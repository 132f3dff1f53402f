"""Compares the age of the newest accepted frame of each message with the message's age limit.

The limits are settings of [supervision]. Consequences of a stale message:

    LATERAL_ERROR     HOLDING (``controller.node.modes``): there is no measurement to steer by
    STEERING_STATUS   the delay is unknown (``controller.history.history``). Laws that do not need
                      it continue: LATERAL_ERROR still closes the loop, and to stop steering would
                      be worse
    VEHICLE_STATE     as above. Its curvature and yaw rate are out of date, and the steer that a
                      law derives from them fades out. Its speed changes slowly and stays in use
"""

from typing import NamedTuple

from ...dbc.messages import Freshness

_NEVER_SEEN, _FRESH, _STALE = Freshness.NEVER_SEEN, Freshness.FRESH, Freshness.STALE
NO_LIMIT_NS = 1 << 62
"""The age limit of a message that never goes stale."""


class AgeLimits(NamedTuple):
    """The age up to which a message counts as fresh [ns]."""

    lateral_error_ns: int
    steering_status_ns: int
    vehicle_state_ns: int


def freshness(arrival_ns: int | None, limit_ns: int, now_ns: int) -> Freshness:
    """Return whether the newest frame of a message is young enough."""
    if arrival_ns is None:
        return _NEVER_SEEN
    return _FRESH if now_ns - arrival_ns <= limit_ns else _STALE
