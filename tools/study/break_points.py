"""Break-point of each law: the largest mean latency that it holds, by bisection, seed by seed.

At one jitter, a law holds a mean latency with a seed if it holds the path under the GROUPS_MAX of
all other conditions in the study (corners, paths, ...) in which it breaks first. These are found by
a search with the first seed, because the condition with the largest error need not break first. The
search covers CANDIDATES_MAX conditions. If there are more, it takes those in which most runs of the
study do not hold, then those with the largest errors. The break-point with that seed is the largest
multiple of STEP_NS that holds, found by galloping from that of the seed before and bisecting. This
assumes that a law that holds a latency holds shorter ones, which the heat maps confirm. One seed
draws the same uniforms for every latency and every law.

Bounds over seeds are right for any distribution. With the break-points of n seeds in order,
b_(1) ≤ ... ≤ b_(n):

    P(b_(r) is at most its q-quantile) = P(Bin(n, q) ≥ r)

so b_(r) with the largest r for which P(Bin(n, 1 - share) ≤ r - 1) ≤ 1 - CONFIDENCE is a bound: at
b_(r) at least ``share`` of all seeds hold, with that confidence. (That is the bound of Clopper and
Pearson: with 29 seeds of which all hold at b_(1), share ≥ 0.05^(1/29) = 0.90.) The interval for the
median comes from the same law at q = 1/2.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from ...closed_loop.reports.page import Cell, Picture, Section, Table, number
from ...closed_loop.reports.plot_style import COLOURS
from ...closed_loop.studies.compiled_figures import COLUMNS, verdict_of
from ...closed_loop.studies.compiled_runs import Computer
from ...closed_loop.studies.result_reader import Rows, StudyRecord, case_of, read_overrides
from ...closed_loop.studies.scenario import Scenarios, replicate_seed
from ...plant_emulator.evaluation.run_verdict import Verdict
from ...runtime.node import NS_PER_S
from .axes import StudyAxes, is_share

SEEDS = 29
"""The smallest number of which, if all hold, at least HELD_SHARE do, with CONFIDENCE."""
HELD_SHARE = 0.90
CONFIDENCE = 0.95
STEP_NS = 10_000_000
LATENCY_NS_MAX = 2 * NS_PER_S
"""Upper end of galloping."""
GROUPS_MAX = 2
CANDIDATES_MAX = 8
JITTERS_MAX = 6
_THREADS = 2


class BreakPoint(NamedTuple):
    """Break-point of a law at one jitter [s]; -1 where it does not even hold latency 0.

    ``by_seed_s``    in ascending order; LATENCY_NS_MAX stands for that and more
    ``held_s``       at least HELD_SHARE of all seeds hold here, with CONFIDENCE; NaN where there
                     are too few seeds
    ``low_s``, ``high_s``   interval of the median, with CONFIDENCE
    """

    controller: int
    jitter: int
    by_seed_s: tuple[float, ...]
    held_s: float
    median_s: float
    low_s: float
    high_s: float


class _Conditions(NamedTuple):
    """The conditions under which a latency is varied: their overrides, and where to start."""

    controller: int
    jitter: int
    overrides: tuple[Mapping[str, Any], ...]
    guess: int


def break_points(
    study: StudyRecord, rows: Rows, axes: StudyAxes, count: int = SEEDS
) -> list[BreakPoint]:
    """Return the break-points of all controllers, jitter by jitter; computes their runs.

    ``count``  of seeds; where nothing is random one is enough
    """
    if axes.mean.factor is None:
        return []
    jitters = len(axes.jitter.values)
    chosen = np.unique(np.linspace(0, jitters - 1, min(jitters, JITTERS_MAX)).round().astype(int))
    conditions = _conditions(study, rows, axes, chosen.tolist())
    seed = int(study.sampling["seed"])
    run_seeds = [replicate_seed(seed, replicate) for replicate in range(count)]
    by_jitter = [[each for each in conditions if each.jitter == j] for j in chosen.tolist()]

    def of_jitter(group: list[_Conditions]) -> list[BreakPoint]:
        return _Search(study.scenarios, axes).break_points(group, run_seeds)

    with ThreadPoolExecutor(_THREADS) as pool:
        return [point for points in pool.map(of_jitter, by_jitter) for point in points]


def largest_held(holds: Callable[[int], bool], guess: int, largest: int) -> int:
    """Return the largest number from 0 to ``largest`` that holds, -1 if none does.

    ``guess``  where to start the search; what holds a number is taken to hold all smaller ones
    """
    low, high, step = -1, largest + 1, 1
    at = min(max(guess, 0), largest)
    while low < at < high:
        if holds(at):
            low, at = at, min(at + step, largest)
        else:
            high, at = at, max(at - step, 0)
        step *= 2
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if holds(middle) else (low, middle)
    return low


class _Search:
    """Searches at one jitter, with the networks that the laws share."""

    def __init__(self, scenarios: Scenarios, axes: StudyAxes) -> None:
        self._computer = Computer(scenarios)
        self._axes = axes

    def break_points(self, group: list[_Conditions], run_seeds: list[int]) -> list[BreakPoint]:
        """Return the break-point of each law."""
        searched = list(group)
        found: list[list[int]] = [[] for _ in group]
        for seed in run_seeds:
            # The laws one after the other: they break at similar latencies, and share the networks
            # of those.
            for place, steps in enumerate(found):
                if not steps:
                    searched[place] = self._first_to_break(searched[place], seed)
                steps.append(self._next(searched[place], seed, steps))
        return list(map(_break_point, searched, found))

    def _next(self, conditions: _Conditions, seed: int, steps: list[int]) -> int:
        if steps and self._is_fixed(conditions):
            return steps[0]
        return self._edge(conditions, seed, steps[-1] if steps else conditions.guess)

    def _first_to_break(self, conditions: _Conditions, seed: int) -> _Conditions:
        """Return those conditions, by their overrides, under which the law breaks first."""
        if len(conditions.overrides) <= GROUPS_MAX:
            return conditions
        edges, guess = [], conditions.guess
        for overrides in conditions.overrides:
            guess = self._edge(conditions._replace(overrides=(overrides,)), seed, guess)
            edges.append(guess)
        chosen = np.argsort(edges, kind="stable")[:GROUPS_MAX].tolist()
        return conditions._replace(
            overrides=tuple(conditions.overrides[place] for place in chosen), guess=min(edges)
        )

    def _edge(self, conditions: _Conditions, seed: int, guess: int) -> int:
        return largest_held(
            lambda at: self._holds(conditions, at, seed), guess, LATENCY_NS_MAX // STEP_NS
        )

    def _holds(self, conditions: _Conditions, steps: int, seed: int) -> bool:
        return all(
            self._run_holds(conditions.controller, overrides | {"plant.seed": seed})
            for overrides in self._at(conditions, steps * STEP_NS / NS_PER_S)
        )

    def _at(self, conditions: _Conditions, mean_s: float) -> list[dict[str, Any]]:
        return [
            dict(overrides) | latency_overrides(self._axes, conditions.jitter, mean_s)
            for overrides in conditions.overrides
        ]

    def _run_holds(self, controller: int, overrides: dict[str, Any]) -> bool:
        scenarios = self._computer.scenarios
        case = case_of(overrides)
        row = np.full(len(COLUMNS), np.nan)
        plant = scenarios.plant(case)
        settings = scenarios.controller(case, scenarios.controllers[controller])
        end = self._computer.one(plant, settings, row)
        return verdict_of(scenarios.study.settings.verdict, end, row) is Verdict.HOLDS

    def _is_fixed(self, conditions: _Conditions) -> bool:
        plants = [
            self._computer.scenarios.plant(case_of(overrides | {"plant.seed": 0}))
            for overrides in self._at(conditions, 0.1)
        ]
        lines = [line for p in plants for line in (p.latency.downlink, p.latency.uplink)]
        return all(
            line.model == "constant" and line.loss == 0.0 and line.loss_in_good == 0.0
            for line in lines
            if not line.schedule
        ) and not any(p.sensor_noise.lateral_error_m or p.latency.downlink.schedule for p in plants)


def latency_overrides(axes: StudyAxes, jitter: int, mean_s: float) -> dict[str, Any]:
    """Return what sets a mean latency, with the spread of a level of jitter."""
    found: dict[str, Any] = dict.fromkeys(axes.mean.keys, mean_s)
    spread = axes.jitter.values[jitter]
    for key in axes.jitter.keys:
        line = key.rpartition(".")[0]
        found[f"{line}.spread_s"] = spread * mean_s if is_share(axes.jitter) else spread
    return found


def _conditions(
    study: StudyRecord, rows: Rows, axes: StudyAxes, jitters: list[int]
) -> list[_Conditions]:
    """Choose for each law and jitter from all other conditions, and where to start."""
    picked: list[tuple[int, int, list[int], int]] = []
    for jitter in jitters:
        for controller in range(len(study.names)):
            here = np.flatnonzero((rows.controller == controller) & (axes.jitter.place == jitter))
            if len(here):
                picked.append((controller, jitter, *_worst(rows, axes, here)))
    overrides = read_overrides(study, sorted({run for *_, runs, _ in picked for run in runs}))
    return [
        _Conditions(controller, jitter, tuple(overrides[run] for run in runs), guess)
        for controller, jitter, runs, guess in picked
    ]


def _worst(rows: Rows, axes: StudyAxes, here: Any) -> tuple[list[int], int]:
    """Return a run of each of the worst groups, and the latency where they break, in steps."""
    groups, place = np.unique(axes.group[here], return_inverse=True)
    failed = np.bincount(place, weights=~rows.holds[here])
    largest_m = np.zeros(len(groups))
    # Among those that all hold, the one nearest to breaking has the largest error.
    np.maximum.at(largest_m, place, np.nan_to_num(rows.rms_m[here], nan=np.inf))
    worst = np.lexsort((-largest_m, -failed))[:CANDIDATES_MAX]
    runs = [int(rows.id[here[np.flatnonzero(place == group)[-1]]]) for group in worst.tolist()]
    bad = here[~rows.holds[here]]
    places = axes.mean.place[bad] if len(bad) else [len(axes.mean.values) - 1]
    guess_s = axes.mean.values[int(np.min(places))]
    return runs, int(guess_s * NS_PER_S) // STEP_NS


def _break_point(conditions: _Conditions, steps: list[int]) -> BreakPoint:
    ascending = tuple(sorted(-1.0 if at < 0 else at * STEP_NS / NS_PER_S for at in steps))
    low_s, high_s = median_interval(ascending, CONFIDENCE)
    return BreakPoint(
        conditions.controller,
        conditions.jitter,
        ascending,
        held_bound(ascending, HELD_SHARE, CONFIDENCE),
        float(np.median(ascending)),
        low_s,
        high_s,
    )


def held_bound(ascending: tuple[float, ...], share: float, confidence: float) -> float:
    """Return where at least ``share`` of all seeds hold, with ``confidence``; NaN if unknown."""
    from scipy.special import bdtr  # scipy.stats takes a second to import

    ranks = np.arange(1, len(ascending) + 1)
    fits = bdtr(ranks - 1, len(ascending), 1.0 - share) <= 1.0 - confidence
    return ascending[int(np.count_nonzero(fits)) - 1] if fits[0] else math.nan


def median_interval(ascending: tuple[float, ...], confidence: float) -> tuple[float, float]:
    """Return an interval that holds the median with ``confidence``; infinite for too few."""
    from scipy.special import bdtr

    count = len(ascending)
    # Of the binomial distribution up to each rank; it rises.
    rank = int(np.count_nonzero(2.0 * bdtr(np.arange(count), count, 0.5) <= 1.0 - confidence))
    return (ascending[rank - 1], ascending[count - rank]) if rank else (-math.inf, math.inf)


def break_point_section(
    study: StudyRecord, axes: StudyAxes, points: Sequence[BreakPoint], pictures: Sequence[Picture]
) -> Section:
    """Return the break-points."""
    if not points:
        return Section("Break-points", ("The study varies no mean latency: there are none.",))
    seeds = max(len(point.by_seed_s) for point in points)
    share, sure = f"{100 * HELD_SHARE:g} %", f"{100 * CONFIDENCE:g} %"
    rows = [
        (
            Cell(study.names[point.controller]),
            number(axes.jitter.labels[point.jitter]),
            number(_latency(point.held_s)),
            number(_latency(point.median_s)),
            number(_from_to(point.low_s, point.high_s)),
            number(_from_to(point.by_seed_s[0], point.by_seed_s[-1])),
        )
        for point in sorted(points, key=lambda point: (point.controller, point.jitter))
    ]
    headings = (
        "Controller",
        axes.jitter.title,
        f"held by {share} of seeds, {sure} sure [ms]",
        "median [ms]",
        f"{sure} interval [ms]",
        f"all {seeds} seeds [ms]",
    )
    return Section(
        "Break-points",
        (
            "The largest mean latency that each law holds, searched by bisection with each of "
            f"{seeds} seeds to {1e-6 * STEP_NS:g} ms, up to {1e-6 * LATENCY_NS_MAX:g} ms, under "
            f"the {GROUPS_MAX} of all other conditions of the study in which that law breaks first "
            f"at that jitter (found with the first seed, of the {CANDIDATES_MAX} worst): a latency "
            "is held only if it is under both. These runs come on top of those of the study.",
        ),
        pictures,
        (Table(headings, rows),),
        (
            "Bounds are order statistics of the break-points of the seeds, exact for any "
            "distribution (binomial; for the lowest break-point it is the bound of Clopper and "
            f"Pearson: all {seeds} of {seeds} seeds hold, so that at least "
            f"{100 * (1.0 - CONFIDENCE) ** (1.0 / seeds):.0f} % of all seeds do, {sure} sure). The "
            "search takes for granted that a law that holds a latency holds shorter ones; see the "
            "maps. A slow instability that the length of a run does not show counts as held.",
        ),
    )


def _from_to(low_s: float, high_s: float) -> str:
    return f"{_latency(low_s)} to {_latency(high_s)}"


def _latency(seconds: float) -> str:
    if math.isnan(seconds):
        return "-"
    if seconds < 0.0:
        return "none"
    return f"≥ {1e3 * seconds:.0f}" if seconds * 1e9 >= LATENCY_NS_MAX else f"{1e3 * seconds:.0f}"


_MARKERS = "os^Dv<>p"
_TICKS_MS = (10, 20, 50, 100, 150, 200, 300, 400, 500, 700, 1000, 1500, 2000)
_SHORTEST_MS = 1e-6 * STEP_NS
"""Where latency 0, or not even that, is drawn: the axis is logarithmic."""


def draw_break_points(points: list[BreakPoint], axes: StudyAxes, names: tuple[str, ...]) -> Figure:
    """Draw the break-point of each law over jitter."""
    figure = Figure(figsize=(9.5, 4.6))
    panel = figure.subplots()
    chosen = sorted({point.jitter for point in points})
    end_ms = 1e-6 * LATENCY_NS_MAX
    for controller, name in enumerate(names):
        own = [point for point in points if point.controller == controller]
        # Beside each other, since laws of the same break-point would hide each other.
        at = np.array([chosen.index(point.jitter) for point in own]) + 0.06 * (
            controller - 0.5 * (len(names) - 1)
        )
        colour = COLOURS[controller % len(COLOURS)]
        median, low, high, held = (
            np.clip([1e3 * getattr(point, name) for point in own], _SHORTEST_MS, end_ms)
            for name in ("median_s", "low_s", "high_s", "held_s")
        )
        bars, marker = (median - low, high - median), _MARKERS[controller % len(_MARKERS)]
        panel.errorbar(at, median, bars, color=colour, marker=marker, ms=5, capsize=3, label=name)
        panel.plot(at, held, ls="", marker="_", ms=11, mew=2, color=colour)
    panel.set_yscale("log")
    low_ms, high_ms = panel.get_ylim()
    if high_ms > 0.8 * end_ms:
        panel.axhline(end_ms, color="0.4", lw=0.8, ls="--")
        panel.annotate(
            "end of the search: held here and beyond",
            (0.02, end_ms),
            (0.0, 3.0),
            xycoords=("axes fraction", "data"),
            textcoords="offset points",
            fontsize=8.5,
        )
        high_ms = 1.3 * end_ms
    low_ms = max((tick for tick in _TICKS_MS if tick <= low_ms), default=low_ms)
    high_ms = min((tick for tick in _TICKS_MS if tick >= high_ms), default=high_ms)
    panel.set_ylim(low_ms, high_ms)
    ticks_ms = [tick for tick in _TICKS_MS if low_ms <= tick <= high_ms]
    panel.set_yticks(ticks_ms, [f"{tick:g}" for tick in ticks_ms])
    panel.set_yticks([], minor=True)
    panel.set_xticks(range(len(chosen)), [axes.jitter.labels[place] for place in chosen])
    panel.set(xlabel=axes.jitter.title, ylabel="largest mean latency held [ms]")
    panel.set_title(
        f"Markers: median over seeds with its {100 * CONFIDENCE:g} % interval.  "
        f"Bars: held by at least {100 * HELD_SHARE:g} % of seeds, {100 * CONFIDENCE:g} % sure",
        fontsize=9.5,
        fontweight="normal",
    )
    panel.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure
