"""When the hand wheel lets the driver feel the road, and what it does when the road falls silent.

    mode        feedback
    WAITING     local damping alone: the road was never heard
    ACTIVE      the law's
    HOLDING     the law's by the newest road, which is no longer fresh
    SAFE_STOP   fades out into local damping, then that alone

WAITING and ACTIVE end as soon as the road is fresh or no longer is, HOLDING and SAFE_STOP after
good messages in a row. A fault of the wheel itself leads to SAFE_STOP for good. The law itself
never branches on any of these.
"""

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


def feedback_mode_step(
    p: FeedbackSupervision,
    x: FeedbackMode,
    age_ns: int | None,
    now_ns: int,
    *,
    has_own_fault: bool = False,
) -> FeedbackMode:
    """Take at most one transition; a hold begins without good messages.

    ``age_ns``         of the newest message of the road; None for a law that reads none
    ``has_own_fault``  whether the hand wheel has a fault of its own, which stays
    """
    is_fresh = age_ns is None or age_ns <= p.timeout_ns
    is_back = age_ns is None or x.good_run >= p.recovery_frames
    following = x.mode
    if has_own_fault:
        following = Mode.SAFE_STOP
    elif x.mode is Mode.WAITING:
        following = Mode.ACTIVE if is_fresh else Mode.WAITING
    elif x.mode is Mode.ACTIVE:
        following = Mode.ACTIVE if is_fresh else Mode.HOLDING
    elif is_back and is_fresh:
        following = Mode.ACTIVE
    elif now_ns - x.entered_ns >= p.hold_ns:
        following = Mode.SAFE_STOP
    if following is x.mode:
        return x
    return FeedbackMode(following, now_ns, 0 if following is Mode.HOLDING else x.good_run)


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
