"""What CONTROLLER_SAFETY says, and when it has to be said between its cycles.

    at the next tick   a message goes stale, a fault is found: has to be on the bus within the fault
                       tolerant time, of which the age limit has used all but a period
    at intervals       anything else that differs from what was told, as a refused frame or a
                       message that is back: at the first tick INTERVAL_NS after the last one, or a
                       flood of bad frames would be answered by one of good frames

A message that comes and goes is told as stale again only after it was told as back, so that both
together are bounded. Lost frames alone wait for the cycle: a network loses some all the time.
"""

from collections.abc import Mapping
from typing import NamedTuple

from ..dbc.messages import ControllerFault, ControllerSafety, Freshness, encode, limits
from ..dbc.protection import COUNTERS
from ..runtime.frame import Frame

INTERVAL_NS = 20_000_000
"""50 frames a second are 1.4 % of a bus of 500 kbit/s, and 20 ms a seventh of the 150 ms in which a
refusal has to be told."""
_AGES = ("lateral_error", "steering_status", "vehicle_state")
_LOST_COUNTERS = int(limits(ControllerSafety)["rejected"].maximum) + 1


class SafetyFacts(NamedTuple):
    """What may have to be said at once."""

    rejected: int
    lateral_error: Freshness
    steering_status: Freshness
    vehicle_state: Freshness
    fault: ControllerFault

    def is_worse_than(self, told: "SafetyFacts") -> bool:
        """Whether a message has gone stale, or a fault was found, since ``told``."""
        stale = Freshness.STALE
        return (
            self.fault is not told.fault
            or (self.lateral_error is stale and told.lateral_error is not stale)
            or (self.steering_status is stale and told.steering_status is not stale)
            or (self.vehicle_state is stale and told.vehicle_state is not stale)
        )


class SafetyStatus:
    """Remembers what was told, and makes the frames."""

    def __init__(self) -> None:
        self._before: SafetyFacts | None = None
        self._went_stale = dict.fromkeys(_AGES, 0)
        self._told: SafetyFacts | None = None
        self._told_ns = 0
        self._sent = 0

    @property
    def went_stale(self) -> Mapping[str, int]:
        """How often each message has gone stale."""
        return dict(self._went_stale)

    def on_tick(self, facts: SafetyFacts, now_ns: int) -> bool:
        """Take the facts of a control tick; returns whether to tell them before the next cycle."""
        before, told = self._before, self._told
        if facts is before and facts is told:
            return False
        if before is not None and facts != before:
            for name in _AGES:
                is_stale, was_stale = (getattr(x, name) is Freshness.STALE for x in (facts, before))
                self._went_stale[name] += is_stale and not was_stale
        self._before = facts
        if told is None or facts == told:
            return False
        return now_ns - self._told_ns >= INTERVAL_NS or facts.is_worse_than(told)

    def frame(self, facts: SafetyFacts, lost: int, now_ns: int) -> Frame:
        """Return the frame that tells ``facts`` and the frames lost so far."""
        self._told, self._told_ns = facts, now_ns
        message = ControllerSafety(
            facts.rejected % _LOST_COUNTERS,
            lost % _LOST_COUNTERS,
            facts.lateral_error,
            facts.steering_status,
            facts.vehicle_state,
            facts.fault,
        )
        counter = self._sent % COUNTERS
        self._sent += 1
        return encode(message, counter)
