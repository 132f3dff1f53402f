"""A receiver of one message beside an intruder who chooses each counter and time of his own."""

from collections.abc import Sequence
from typing import NamedTuple

from steer_by_wire.dbc.codec.sequence_and_second_sender import (
    CHANGING,
    SequenceCheck,
    SequenceResult,
    SequenceRule,
)
from steer_by_wire.runtime.node import NS_PER_MS

PERIOD_NS = 10 * NS_PER_MS
ALONE = 150
"""Frames of the true sender before the first forged one."""


class Shot(NamedTuple):
    """A forged frame: how long after a true one, and how many counters ahead of it."""

    after_ns: int
    ahead: int


class Event(NamedTuple):
    """A frame that comes: when, its number, whether it is forged, and the result of the check."""

    time_ns: int
    number: int
    is_forged: bool
    result: SequenceResult


class Heard(NamedTuple):
    """What a receiver heard, and when a forged frame was in use: from, to [ns].

    It is until the next frame, or until the receiver holds because none came for ``resync_ns``.
    """

    events: Sequence[Event]
    forged_ns: Sequence[tuple[int, int]]
    check: SequenceCheck

    @property
    def forged_total_ns(self) -> int:
        return sum(until_ns - since_ns for since_ns, until_ns in self.forged_ns)


def hear(
    rule: SequenceRule,
    shots: Sequence[Sequence[Shot]],
    *,
    repeats: bool,
    frames: int = 200,
    first: int = 0,
) -> Heard:
    """Let a receiver hear the true sender, and ``shots`` behind its frames from ALONE on, in turn.

    ``repeats``  whether they begin again after the last
    ``frames``   of the true sender beside the intruder
    ``first``    counter of the first true frame
    """
    sent = [(number * PERIOD_NS, -1, number, False) for number in range(ALONE + frames)]
    last_ns = sent[-1][0]
    for step in range(frames if repeats else min(frames, len(shots))):
        number = ALONE + step
        for order, (after_ns, ahead) in enumerate(shots[step % len(shots)]):
            sent.append((number * PERIOD_NS + after_ns, order, number + ahead, True))
    check = SequenceCheck(rule, PERIOD_NS)
    events, forged_ns = [], []
    since_ns: int | None = None
    for time_ns, _, number, is_forged in sorted(sent):
        if time_ns > last_ns:
            break
        content = (is_forged, number)
        result = check.check((first + number) % 256, time_ns, content)
        events.append(Event(time_ns, number, is_forged, result))
        if result in CHANGING:
            if since_ns is not None:
                forged_ns.append((since_ns, min(time_ns, since_ns + rule.resync_ns)))
            assert isinstance(check.content, tuple)
            since_ns = time_ns if check.content[0] else None
    if since_ns is not None:
        forged_ns.append((since_ns, min(last_ns, since_ns + rule.resync_ns)))
    return Heard(events, forged_ns, check)


class Absence(NamedTuple):
    """When the true sender is silent, in its periods, and by how much its counters then leap."""

    since: int
    until: int
    leap: int


def followed_after(
    rule: SequenceRule,
    shots: Sequence[Sequence[Shot]],
    absence: Absence,
    *,
    first: int = 0,
    frames: int = 500,
) -> int:
    """Return how many forged frames come into use after the absence of the true sender.

    The intruder begins with the receiver, and takes no notice of whether the true sender is there.
    """
    sent = []
    for number in range(frames):
        if not absence.since <= number < absence.until:
            leap = absence.leap if number >= absence.until else 0
            sent.append((number * PERIOD_NS, -1, number + leap, False))
        for order, (after_ns, ahead) in enumerate(shots[number % len(shots)]):
            sent.append((number * PERIOD_NS + after_ns, order, number + ahead, True))
    check, back_ns, followed = SequenceCheck(rule, PERIOD_NS), absence.until * PERIOD_NS, 0
    for time_ns, _, number, is_forged in sorted(sent):
        result = check.check((first + number) % 256, time_ns, (is_forged, number))
        if result in CHANGING and time_ns >= back_ns:
            assert isinstance(check.content, tuple)
            followed += check.content[0]
    return followed
