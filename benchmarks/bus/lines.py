"""The lines of the benchmark's result: figures of each repetition, and ratios within it."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

from steer_by_wire.runtime.node import NS_PER_S, NS_PER_US

from ..measurement import Line, Target
from .allocations import TickMemory
from .records import between, lateness, skipped
from .runs import BARE_PYTHON, C_ECHO, NODE, PYTHON_WITH_TIMEOUT, AnswerRun, TickRun

TURN_AROUND_RATIO = Target(at_most=True, value=1.5)
LATENESS_RATIO = Target(at_most=True, value=2.0)
NONE = Target(at_most=True, value=0.0)
RESOLUTION_NS = 1
"""Stands for a time of zero where a ratio is computed."""


class _Ratio(NamedTuple):
    """The figure of which a ratio is taken, the reference, and the target."""

    quantile: str
    to: str
    target: Target | None = None


_RATIOS = (
    _Ratio("p50", BARE_PYTHON, TURN_AROUND_RATIO),
    _Ratio("p99", BARE_PYTHON),
    _Ratio("p50", PYTHON_WITH_TIMEOUT),
    _Ratio("p50", C_ECHO),
)


def answer_lines(runs: Mapping[str, Sequence[AnswerRun]]) -> list[Line]:
    """Return the turn-around of each answering program, and ratios; the runs are in repetitions."""
    figures = {
        (who, quantile): [_quantile_ns(run.answers.durations, quantile) for run in repetitions]
        for who, repetitions in runs.items()
        for quantile in ("p50", "p99")
    }
    times = [
        _line(f"turn-around, {who}, {quantile}", "µs", [ns / NS_PER_US for ns in values])
        for (who, quantile), values in figures.items()
    ]
    ratios = [
        _line(
            f"turn-around, {NODE}, to {ratio.to}, {ratio.quantile}",
            "x",
            _ratios(figures[NODE, ratio.quantile], figures[ratio.to, ratio.quantile]),
            ratio.target,
        )
        for ratio in _RATIOS
    ]
    unanswered = [float(run.answers.unanswered) for run in runs[NODE]]
    return [*times, *ratios, _line(f"requests unanswered, {NODE}", "", unanswered)]


def tick_lines(runs: Sequence[TickRun]) -> list[Line]:
    """Return lateness and turn-around of a controller at its rate, beside the C loop."""
    rate = f"{NS_PER_S // runs[0].period_ns} Hz"
    own = [lateness(run.ticks) for run in runs]
    reference = [lateness(run.reference) for run in runs]
    lines = []
    for quantile in ("p50", "p99"):
        for who, summaries in (("controller", own), ("C loop", reference)):
            microseconds = [_quantile_ns(s, quantile) / NS_PER_US for s in summaries]
            lines.append(_line(f"lateness, {rate}, {who}, {quantile}", "µs", microseconds))
    p99 = _ratios([s.p99_ns for s in own], [s.p99_ns for s in reference])
    lines.append(_line(f"lateness, {rate}, controller to C loop, p99", "x", p99, LATENESS_RATIO))
    durations = [run.answers.durations for run in runs if run.answers is not None]
    for quantile in ("p50", "p99") if durations else ():
        figures = [_quantile_ns(each, quantile) / NS_PER_US for each in durations]
        lines.append(_line(f"turn-around, controller at {rate}, {quantile}", "µs", figures))
    return lines


def skipped_lines(run: TickRun) -> list[Line]:
    """Return the periods a long run has missed."""
    rate = f"{NS_PER_S // run.period_ns} Hz"
    own = skipped(run.ticks, run.reference, run.period_ns)
    loop = skipped(run.reference, run.ticks, run.period_ns)
    seconds = (run.reference[-1].deadline_ns - run.reference[0].deadline_ns) / NS_PER_S
    name = f"skipped in {seconds:.0f} s at {rate}"
    return [
        _line(f"{name}, controller", "", [float(own.total)]),
        _line(f"{name}, C loop", "", [float(loop.total)]),
        _line(f"{name}, controller but not C loop", "", [float(own.own)], NONE),
    ]


def memory_lines(memory: TickMemory, reports: Sequence[Mapping[str, float]]) -> list[Line]:
    """Return collections and allocations; ``reports`` are those of the live runs' nodes."""
    blocks = [report["blocks_kept_per_tick"] for report in reports]
    kept = [each for each in blocks if each is not None]
    collections = [float(report["collections"]) for report in reports]
    if_on = f"the same, were it on, {memory.ticks} ticks"
    lines = [
        _line("garbage collections in the loop", "", collections, NONE),
        _line(if_on, "", [float(memory.collections_if_on)]),
        _line("memory taken in a tick, at most", "bytes", [memory.bytes_at_peak]),
        _line("memory kept after a tick", "bytes", [memory.bytes_kept]),
    ]
    return [*lines, _line("blocks kept after a tick", "", kept)] if kept else lines


def parts(run: TickRun, count: int) -> list[TickRun]:
    """Divide a long run into ``count`` of equal length, as repetitions of its lateness."""
    begin_ns, end_ns = run.reference[0].deadline_ns, run.reference[-1].deadline_ns
    edges = [begin_ns + (end_ns - begin_ns) * index // count for index in range(count + 1)]
    return [
        run._replace(ticks=between(run.ticks, *edge), reference=between(run.reference, *edge))
        for edge in pairwise(edges)
    ]


def _quantile_ns(summary: object, quantile: str) -> float:
    return float(getattr(summary, f"{quantile}_ns"))


def _ratios(figures: Sequence[float], others: Sequence[float]) -> list[float]:
    return [a / max(b, RESOLUTION_NS) for a, b in zip(figures, others, strict=True)]


def _line(name: str, unit: str, figures: Sequence[float], target: Target | None = None) -> Line:
    return Line(name, unit, list(figures), list(figures), target)
