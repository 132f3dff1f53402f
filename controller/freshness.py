"""How old the newest accepted frame of each message is, beside the age limit of its message.

The limits are settings of [supervision]. What follows from a message that is stale:

    LATERAL_ERROR     HOLDING (``controller.modes``): there is nothing to steer by
    STEERING_STATUS   the delay is not known any more (``controller.link_memory``); laws that do
                      not need it go on, since LATERAL_ERROR closes the loop and not to steer any
                      more would be worse
    VEHICLE_STATE     as above, and its curvature and yaw rate are not those of now: what a law
                      makes of them fades out. Its speed, which changes slowly, stays in use
"""

from typing import NamedTuple

from ..dbc.messages import Freshness

NO_LIMIT_NS = 1 << 62
"""The age limit of a message that never goes stale."""


class AgeLimits(NamedTuple):
    """The age up to which a message is believed to tell of now [ns]."""

    lateral_error_ns: int
    steering_status_ns: int
    vehicle_state_ns: int


def freshness(arrival_ns: int | None, limit_ns: int, now_ns: int) -> Freshness:
    """Return whether the newest frame of a message is young enough."""
    if arrival_ns is None:
        return Freshness.NEVER_SEEN
    return Freshness.FRESH if now_ns - arrival_ns <= limit_ns else Freshness.STALE
