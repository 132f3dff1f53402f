"""Reads the logs of the benchmark's programs, and derives its figures.

A tick, of the controller or of the C loop, is a deadline and when it was served, both on the same
clock. A missed period has no tick. A period that the controller missed is its own fault if the C
loop, on the same machine at the same time, woke up within it; otherwise no program could have met
it: the host had stopped, or a process of higher priority ran.
"""

import struct
from bisect import bisect_left
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from steer_by_wire.runtime.node.statistics import DurationStatistics, DurationSummary

_PASSAGE = struct.Struct("=qIBB2x8s")
_TICK = struct.Struct("=qq")


class Passage(NamedTuple):
    """A frame on the bus.

    ``stamp_ns``  when it passed, by the kernel's wall clock [ns]
    ``is_own``    whether the program that wrote the log has sent it
    """

    stamp_ns: int
    can_id: int
    is_own: bool
    data: bytes


class Tick(NamedTuple):
    """A deadline, and when it was served [ns, monotonic clock]."""

    deadline_ns: int
    served_ns: int


class Answers(NamedTuple):
    """How long requests took to be answered, and how many were not."""

    durations: DurationSummary
    unanswered: int


class Skipped(NamedTuple):
    """Missed periods, and how many of them the C loop met."""

    total: int
    own: int


def read_passages(path: Path) -> list[Passage]:
    """Read the log of ``requester.c``."""
    return [
        Passage(stamp_ns, can_id, bool(is_own), data[:length])
        for stamp_ns, can_id, is_own, length, data in _PASSAGE.iter_unpack(path.read_bytes())
    ]


def read_ticks(path: Path) -> list[Tick]:
    """Read the log of ``timer_loop.c`` or of ``watched_controller``."""
    return [Tick(*fields) for fields in _TICK.iter_unpack(path.read_bytes())]


def answers(passages: Iterable[Passage], reply_id: int) -> Answers:
    """Return how long after each own frame the first reply to it passed.

    A reply after the next own frame answers that one.
    """
    statistics = DurationStatistics()
    asked_ns: int | None = None
    unanswered = 0
    for passage in passages:
        if passage.is_own:
            unanswered += asked_ns is not None
            asked_ns = passage.stamp_ns
        elif passage.can_id == reply_id and asked_ns is not None:
            statistics.record(max(passage.stamp_ns - asked_ns, 0))  # wall clocks may be set
            asked_ns = None
    return Answers(statistics.summary(), unanswered + (asked_ns is not None))


def lateness(ticks: Iterable[Tick]) -> DurationSummary:
    """Return how long after its deadline each tick was served."""
    statistics = DurationStatistics()
    for tick in ticks:
        statistics.record(tick.served_ns - tick.deadline_ns)
    return statistics.summary()


def between(ticks: Iterable[Tick], begin_ns: int, end_ns: int) -> list[Tick]:
    """Return the ticks with a deadline from ``begin_ns`` to before ``end_ns``."""
    return [tick for tick in ticks if begin_ns <= tick.deadline_ns < end_ns]


def skipped(ticks: Iterable[Tick], reference: Sequence[Tick], period_ns: int) -> Skipped:
    """Return the periods without a tick; the C loop's ticks are ``reference``.

    A tick served in a later period has missed all periods from its own up to that one.
    """
    missed = [
        deadline_ns
        for tick in ticks
        for deadline_ns in range(tick.deadline_ns, tick.served_ns - period_ns + 1, period_ns)
    ]
    woke_ns = [tick.served_ns for tick in reference]
    own = sum(
        bisect_left(woke_ns, deadline_ns) < bisect_left(woke_ns, deadline_ns + period_ns)
        for deadline_ns in missed
    )
    return Skipped(len(missed), own)
