"""Separates measurements taken while the host gave processor time to another machine.

A virtual machine that is stopped cannot be on time. Linux counts the time stolen from it, coarsely;
so time is cut into slices, and a slice in which any was stolen is disturbed as a whole.
"""

from collections.abc import Callable
from typing import Generic, NamedTuple, TypeVar

from ...runtime.host import StealClock
from ...runtime.node import NS_PER_MS

SLICE_NS = 200 * NS_PER_MS

T = TypeVar("T")


class Sliced(NamedTuple, Generic[T]):
    """What was measured.

    ``undisturbed``     samples of the slices without stolen time, as far as it is known
    ``steal_fraction``  of all processors' time, 0 to 1; None where the platform does not report it
    """

    samples: list[T]
    undisturbed: list[T]
    steal_fraction: float | None


class Slices(Generic[T]):
    """Takes samples of any kind, as they are measured."""

    def __init__(self, make_clock: Callable[[], StealClock] = StealClock) -> None:
        self._make_clock = make_clock
        self._whole = self._clock = make_clock()
        self._samples: list[T] = []
        self._undisturbed: list[T] = []
        self._begin = 0  # of the slice, in samples
        self._end_ns: int | None = None

    def add(self, sample: T, now_ns: int) -> None:
        """Take a sample that ended at ``now_ns``."""
        self._samples.append(sample)
        if self._end_ns is None:
            self._end_ns = now_ns + SLICE_NS
        elif now_ns >= self._end_ns:
            self._cut()
            self._end_ns = now_ns + SLICE_NS

    def result(self) -> Sliced[T]:
        """End the last slice."""
        self._cut()
        return Sliced(self._samples, self._undisturbed, self._whole.fraction())

    def _cut(self) -> None:
        if not self._clock.fraction():
            self._undisturbed += self._samples[self._begin :]
        self._begin = len(self._samples)
        self._clock = self._make_clock()
