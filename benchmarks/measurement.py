"""How the benchmarks measure and print: repetitions, their median and spread, and one fixed loop.

Times of two machines cannot be compared. Their ratios to the time of one fixed loop of plain Python
arithmetic, measured in the same run, compare much better.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from statistics import median
from types import MappingProxyType
from typing import Any, NamedTuple

from rich import box
from rich.table import Table

from steer_by_wire.runtime.program.garbage_collection import no_collections

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


class Measured(NamedTuple):
    """What a benchmark has measured.

    ``notes``           printed below the table
    ``record``          more for JSON
    ``calibration_us``  of the calibration loop, if ratios to it are of use [µs]
    """

    lines: list[Line]
    notes: Sequence[str] = ()
    record: Mapping[str, Any] = MappingProxyType({})
    calibration_us: float | None = None


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
    with no_collections():
        begin_ns = time.perf_counter_ns()
        work()
        return (time.perf_counter_ns() - begin_ns) / 1000


def lines_table(lines: Sequence[Line], calibration_us: float | None = None) -> Table:
    """Return a table; with a column of ratios if the calibration loop was timed."""
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    table.add_column("what")
    ratio = [] if calibration_us is None else ["ratio"]
    for heading in ("median", "least", "most", "unit", *ratio, "target", "verdict"):
        table.add_column(heading, justify="right", no_wrap=True, min_width=len(heading))
    for line in lines:
        figures = (line.median, min(line.figures), max(line.figures))
        verdict = {None: "", True: "met", False: "missed"}[line.is_met]
        table.add_row(
            line.name,
            *(_short(figure) for figure in figures),
            line.unit,
            *([] if calibration_us is None else [_short(line.ratio(calibration_us))]),
            line.target.text if line.target else "",
            verdict,
        )
    return table


def line_record(line: Line, calibration_us: float | None = None) -> dict[str, Any]:
    """Return a line for JSON."""
    record = {
        "name": line.name,
        "unit": line.unit,
        "median": line.median,
        "least": min(line.figures),
        "greatest": max(line.figures),
        "repetitions": len(line.figures),
        "target": line.target.text if line.target else None,
        "is_met": line.is_met,
    }
    if calibration_us is not None:
        record["ratio_to_calibration"] = line.ratio(calibration_us)
    return record


def _short(figure: float) -> str:
    return f"{figure:.3g}" if figure < 1000.0 else f"{figure:.0f}"
