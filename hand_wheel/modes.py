"""Modes of the hand wheel: when the driver feels the road, and what is done when it falls silent.

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
from ..runtime.node import NEVER_NS


class FeedbackSupervision(NamedTuple):
    """When the road counts.

    ``timeout_ns``       an older message is stale [ns]
    ``hold_ns``          how long the newest is used then, before the feedback fades out [ns]
    ``recovery_frames``  good messages in a row that end HOLDING and SAFE_STOP
    ``share_step``       largest change of the law's share of the torque in a cycle
    ``needs_road``       whether the law reads a message of the road
    """

    timeout_ns: int
    hold_ns: int
    recovery_frames: int
    share_step: float
    needs_road: bool


class FeedbackMode(NamedTuple):
    """The mode, when it was entered [ns], and what it goes by.

    ``good_run``  good messages of the road in a row since the last gap
    ``heard_ns``  when the newest one came [ns]
    ``share``     the law's share of the torque
    """

    mode: Mode
    entered_ns: int
    good_run: int = 0
    heard_ns: int = -NEVER_NS
    share: float = 0.0


def feedback_mode_step(
    p: FeedbackSupervision, x: FeedbackMode, now_ns: int, *, has_own_fault: bool = False
) -> FeedbackMode:
    """Take at most one transition; a hold begins without good messages.

    ``has_own_fault``  whether the hand wheel has a fault of its own, which stays
    """
    mode, entered_ns, good_run, heard_ns, _ = x
    is_fresh = not p.needs_road or now_ns - heard_ns <= p.timeout_ns
    is_back = not p.needs_road or good_run >= p.recovery_frames
    if has_own_fault:
        mode = Mode.SAFE_STOP
    elif mode is Mode.WAITING:
        mode = Mode.ACTIVE if is_fresh else Mode.WAITING
    elif mode is Mode.ACTIVE:
        mode = Mode.ACTIVE if is_fresh else Mode.HOLDING
    elif is_back and is_fresh:
        mode = Mode.ACTIVE
    elif now_ns - entered_ns >= p.hold_ns:
        mode = Mode.SAFE_STOP
    if mode is not x.mode:
        entered_ns, good_run = now_ns, 0 if mode is Mode.HOLDING else good_run
    return FeedbackMode(mode, entered_ns, good_run, heard_ns, _share(p, x, mode))


def good_message(p: FeedbackSupervision, x: FeedbackMode, now_ns: int) -> FeedbackMode:
    """Count a message of the road that comes now."""
    is_gap = now_ns - x.heard_ns > p.timeout_ns
    return x._replace(good_run=1 if is_gap else x.good_run + 1, heard_ns=now_ns)


def _share(p: FeedbackSupervision, x: FeedbackMode, mode: Mode) -> float:
    """Return the law's share in a mode; the road that is heard first has all of it at once."""
    if mode is Mode.WAITING:
        return 0.0
    share = 1.0 if x.mode is Mode.WAITING else x.share
    if mode is Mode.HOLDING:
        return share
    return min(share + p.share_step, 1.0) if mode is Mode.ACTIVE else max(share - p.share_step, 0.0)
