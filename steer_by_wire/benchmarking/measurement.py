"""How the benchmark measures: repetitions, their median and spread, and the same loop everywhere.

Times of two machines cannot be compared. Their ratios to the time of one fixed loop of plain Python
arithmetic, measured in the same run, compare much better.
"""

import gc
import time
from collections.abc import Callable
from statistics import median
from typing import NamedTuple

REPETITIONS = 7
CALIBRATION_STEPS = 1000
"""Additions and multiplications of the calibration loop: tens of microseconds."""


class Target(NamedTuple):
    """What a figure should be: at most, or else at least, ``value``."""

    at_most: bool
    value: float

    def is_met(self, measured: float) -> bool:
        """Whether a figure meets the target."""
        return measured <= self.value if self.at_most else measured >= self.value

    @property
    def text(self) -> str:
        """The target in a few characters."""
        return f"{'≤' if self.at_most else '≥'} {self.value:g}"


class Line(NamedTuple):
    """One line of the result.

    ``figures``  one per repetition, in ``unit``
    ``work_us``  time of each repetition that is divided by the calibration loop's [µs]
    """

    name: str
    unit: str
    figures: list[float]
    work_us: list[float]
    target: Target | None = None

    @property
    def median(self) -> float:
        """The figure that is reported."""
        return median(self.figures)

    @property
    def is_met(self) -> bool | None:
        """Whether the median meets the target; None without one."""
        return None if self.target is None else self.target.is_met(self.median)

    def ratio(self, calibration_us: float) -> float:
        """Return the median of the work, in runs of the calibration loop."""
        return median(self.work_us) / calibration_us


def timed(
    name: str, work: Callable[[], object], count: int, target_us: float | None = None
) -> Line:
    """Time ``work``, which does one thing ``count`` times; returns a line in microseconds each.

    The garbage collector is off meanwhile, as it is while the programs run.
    """
    work()  # caches, and the interpreter's own specialisation
    figures = [_elapsed_us(work) / count for _ in range(REPETITIONS)]
    target = None if target_us is None else Target(at_most=True, value=target_us)
    return Line(name, "µs", figures, figures, target)


def calibration() -> Line:
    """Time the loop that everything else is compared with."""
    return timed(f"calibration, {CALIBRATION_STEPS} steps", _arithmetic, 1)


def _arithmetic() -> float:
    value = 0.0
    for _ in range(CALIBRATION_STEPS):
        value = value * 0.999 + 0.5
    return value


def _elapsed_us(work: Callable[[], object]) -> float:
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        begin_ns = time.perf_counter_ns()
        work()
        return (time.perf_counter_ns() - begin_ns) / 1000
    finally:
        if was_enabled:
            gc.enable()
