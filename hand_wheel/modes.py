"""When the hand wheel lets the driver feel the road, and what it does when the road falls silent.

    mode        feedback
    WAITING     local damping alone: the road was never heard
    ACTIVE      the law's
    HOLDING     the law's by the newest road, which is no longer fresh
    SAFE_STOP   fades out into local damping, then that alone

As in the controller's table, in each mode the first row with a true guard decides. The law itself
never branches on any of these.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple

from ..dbc.messages import Mode


class FeedbackSupervision(NamedTuple):
    """When the road counts.

    ``timeout_ns``       an older message is stale [ns]
    ``hold_ns``          how long the newest is used then, before the feedback fades out [ns]
    ``recovery_frames``  good messages in a row that end HOLDING and SAFE_STOP
    """

    timeout_ns: int
    hold_ns: int
    recovery_frames: int


class FeedbackMode(NamedTuple):
    """The mode, when it was entered [ns], and good messages in a row since the last gap."""

    mode: Mode
    entered_ns: int
    good_run: int


class RoadEvidence(NamedTuple):
    """What is known of the road.

    ``arrival_ns``  when the newest message came [ns]; None before the first
    ``is_needed``   whether the law reads messages of the road
    ``own_fault``   whether the hand wheel has a fault of its own, which stays
    """

    arrival_ns: int | None
    is_needed: bool
    own_fault: bool


Guard = Callable[[FeedbackSupervision, FeedbackMode, RoadEvidence, int], bool]


def is_fresh(p: FeedbackSupervision, _x: FeedbackMode, road: RoadEvidence, now_ns: int) -> bool:
    """Whether the road was heard recently enough, or the law needs no road."""
    if not road.is_needed:
        return True
    return road.arrival_ns is not None and now_ns - road.arrival_ns <= p.timeout_ns


def is_stale(p: FeedbackSupervision, x: FeedbackMode, road: RoadEvidence, now_ns: int) -> bool:
    """Whether the newest message is too old."""
    return not is_fresh(p, x, road, now_ns)


def is_trusted(p: FeedbackSupervision, x: FeedbackMode, road: RoadEvidence, now_ns: int) -> bool:
    """Whether the road is back, and nothing else is wrong."""
    is_back = not road.is_needed or x.good_run >= p.recovery_frames
    return is_back and not road.own_fault and is_fresh(p, x, road, now_ns)


def is_at_fault(_p: FeedbackSupervision, _x: FeedbackMode, road: RoadEvidence, _n: int) -> bool:
    """Whether the hand wheel has detected a fault in itself."""
    return road.own_fault


def is_held_enough(
    p: FeedbackSupervision, x: FeedbackMode, _road: RoadEvidence, now_ns: int
) -> bool:
    """Whether HOLDING has lasted for its time."""
    return now_ns - x.entered_ns >= p.hold_ns


TRANSITIONS: Mapping[Mode, tuple[tuple[Guard, Mode], ...]] = {
    Mode.WAITING: ((is_at_fault, Mode.SAFE_STOP), (is_fresh, Mode.ACTIVE)),
    Mode.ACTIVE: ((is_at_fault, Mode.SAFE_STOP), (is_stale, Mode.HOLDING)),
    Mode.HOLDING: (
        (is_at_fault, Mode.SAFE_STOP),
        (is_trusted, Mode.ACTIVE),
        (is_held_enough, Mode.SAFE_STOP),
    ),
    Mode.SAFE_STOP: ((is_trusted, Mode.ACTIVE),),
}


def feedback_mode_step(
    p: FeedbackSupervision, x: FeedbackMode, road: RoadEvidence, now_ns: int
) -> FeedbackMode:
    """Take at most one transition; a hold begins without good messages."""
    for guard, following in TRANSITIONS[x.mode]:
        if guard(p, x, road, now_ns):
            return FeedbackMode(following, now_ns, 0 if following is Mode.HOLDING else x.good_run)
    return x


def good_messages(
    p: FeedbackSupervision, x: FeedbackMode, before_ns: int | None, now_ns: int
) -> FeedbackMode:
    """Count a message of the road that comes now; ``before_ns`` is when the one before came."""
    is_gap = before_ns is None or now_ns - before_ns > p.timeout_ns
    return x._replace(good_run=1 if is_gap else x.good_run + 1)


def share_step(share: float, before: Mode, mode: Mode, step: float) -> float:
    """Return the law's share of the torque in a mode; ``step`` is what a cycle can change.

    The road that is heard first has all of it at once.
    """
    if mode is Mode.WAITING:
        return 0.0
    share = 1.0 if before is Mode.WAITING else share
    if mode is Mode.HOLDING:
        return share
    return min(share + step, 1.0) if mode is Mode.ACTIVE else max(share - step, 0.0)
