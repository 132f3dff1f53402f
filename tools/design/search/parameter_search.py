"""Finds the parameters of a law: an evolution strategy, then descent on the lattice.

While a demand is not met, the cost is how far it is from being met. So the search first finds the
feasible set, and then minimises the objective in it. The evolution works on the logarithms of the
parameters and is judged by the coarse study. Its result is moved to the lattice. From there the
search goes to better neighbours until there is none, judged first by the coarse study, then by the
fine one. The result is the best point of the lattice whose stability the eigenvalues confirm.
"""

import math
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import suppress
from itertools import combinations, product
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ....controller.analysis.sampled_loop import SampledLoop
from ....runtime.array_types import FloatArray
from ....runtime.node import NS_PER_MS
from ..demands import NEARLY_MET, Judgement, Study, judge_candidate, judge_law, may_be_better
from ..loop_figures import behind_lag
from .evolution import Generation, evolve
from .law_parameters import Candidate, bounds, controller_settings, designs, values_at
from .stop_and_resume import KeptCosts, SearchStoppedError

DELAY_NS_MAX = 2_000 * NS_PER_MS
_STABLE_1_S = 1e-3

_INFEASIBLE = 1e6
"""Cost of a violation of 0; no objective comes near."""
_OUTSIDE = 1e9
"""Cost at the bounds of the parameters, beyond which nothing is judged."""
_KEPT = 40
"""How many of the best of one study are tried in the next until one passes."""
_SPREAD_MIN = 0.3
"""Steps of the lattice; an evolution that varies less has ended."""
_FIRST_SPREAD = 0.25
"""Standard deviation of the first generation, of the range that is searched."""
_SPREAD_NEAR = 0.2
"""Share of that, for an evolution that begins near a known candidate."""

_COARSE_SHARE = 0.75
"""How much of a search is by the coarse study, at most."""
_HALVED_AFTER = 150.0
"""Candidates of the fine study after which half of the rest of the progress has been shown."""

Progress = Callable[[float, float], None]
"""Called with the share of the search that is done at most, and the best cost so far.

It raises SearchStoppedError to end the search.
"""


class Confirmation(NamedTuple):
    """Stability of a law by eigenvalues.

    ``decay_1_s``         of the slowest mode over all corners and delays of the range [1/s]
    ``failures``          how many loops do not do what is demanded of them
    ``stable_up_to_ns``   the largest of 0, step, 2 step, ... up to which every corner is stable
    ``with_lag_up_to_ns``  the same behind the lag of the steering; None where none is specified
    """

    decay_1_s: float
    failures: int
    stable_up_to_ns: int
    with_lag_up_to_ns: int | None

    @property
    def stable(self) -> bool:
        """Whether all is as demanded."""
        return self.failures == 0


def confirm(study: Study, candidate: Candidate) -> Confirmation:
    """Return the results from the eigenvalues of every loop of the specification.

    The search counts encirclements on a grid; this has no grid.
    """
    spec = study.spec
    design, _ = designs(controller_settings(spec, study.vehicle, candidate.law, candidate.values()))
    settling_1_s = spec.d_stability.settling_1_s
    step_ns = round(spec.delay.step_ms * NS_PER_MS)
    loops = [SampledLoop(design, model, spec.period_ns) for model in study.models]
    decays = [loop.decay_1_s(delay_ns) for loop in loops for delay_ns in spec.delays_ns]
    demanded = settling_1_s if "settling" in study.stability else _STABLE_1_S
    failures = sum(decay <= demanded for decay in decays)
    if "delay margin" in study.stability:
        beyond_ns = tuple(d for d in spec.margin_delays_ns if d > spec.delays_ns[-1])
        failures += _failures(loops, beyond_ns)
    with_lag_ns = None
    if spec.actuator is not None:
        lag_s = spec.actuator.lag_s
        lagged = [
            SampledLoop(design, behind_lag(model, lag_s), spec.period_ns) for model in study.models
        ]
        if "actuator lag" in study.stability:
            failures += _failures(lagged, spec.lag_delays_ns)
        with_lag_ns = stable_up_to_ns(lagged, step_ns)
    return Confirmation(min(decays), failures, stable_up_to_ns(loops, step_ns), with_lag_ns)


def stable_up_to_ns(loops: list[SampledLoop], step_ns: int) -> int:
    """Return the last delay of 0, step, 2 step, ... before the first that any loop fails at [ns].

    -1 if one is unstable without delay.
    """
    for delay_ns in range(0, DELAY_NS_MAX + 1, step_ns):
        if not all(loop.is_stable(delay_ns) for loop in loops):
            return max(-1, delay_ns - step_ns)
    return DELAY_NS_MAX


def _failures(loops: list[SampledLoop], delays_ns: tuple[int, ...]) -> int:
    return sum(not loop.is_stable(delay_ns) for loop in loops for delay_ns in delays_ns)


class Found(NamedTuple):
    """The outcome of a search.

    ``candidate``     the best; with the least violation where none meets all demands
    ``judgement``     of the fine study
    ``confirmation``  by eigenvalues; None where the fine study did not pass it
    ``judged``        how many sets of parameters were judged
    ``ended``         whether the search came to its end; otherwise this is its best so far
    """

    candidate: Candidate
    judgement: Judgement
    confirmation: Confirmation | None
    judged: int
    ended: bool = True

    @property
    def feasible(self) -> bool:
        """Whether all demands are met."""
        return self.confirmation is not None and self.confirmation.stable


class _Lattice:
    """Judges each candidate of the lattice once; ``show`` is called with the costs so far.

    One outside the bounds is not judged: no filter may be at or above the Nyquist frequency.

    ``screen``  the coarse study that tells which candidates of a fine one need not be judged
    """

    def __init__(
        self,
        study: Study,
        law: str,
        kept: KeptCosts,
        show: Callable[[Collection[float]], None],
        screen: Study | None,
    ) -> None:
        self._study = study
        self._bounds = bounds_of(study, law)
        self._kept = kept
        self.show = show
        self._screen = screen
        self.known: dict[Candidate, float] = {}

    def cost(self, candidate: Candidate, ceiling: float = math.inf) -> float:
        """Return the cost; the ceiling instead, if it is plain that the cost is no less."""
        if candidate not in self.known:
            if self._is_worse(candidate, ceiling):
                return ceiling
            what = ("lattice", self._screen is None, candidate.places)
            self.known[candidate] = self._kept.cost(what, lambda: self._judged(candidate))
            self.show(self.known.values())
        return self.known[candidate]

    def best(self) -> list[Candidate]:
        return sorted(self.known, key=lambda candidate: (self.known[candidate], candidate))

    def _judged(self, candidate: Candidate) -> float:
        beyond = _beyond(self._bounds, candidate.places)
        if beyond:
            return _OUTSIDE * (1.0 + beyond)
        return cost(judge_candidate(self._study, candidate))

    def _is_worse(self, candidate: Candidate, ceiling: float) -> bool:
        if self._screen is None or ceiling >= _INFEASIBLE:
            return False
        if _beyond(self._bounds, candidate.places):
            return True
        law, values = candidate.law, candidate.values()
        return not may_be_better(self._screen, self._study, law, values, ceiling)


def bounds_of(study: Study, law: str) -> FloatArray:
    """Return the lowest and the highest place of each parameter, shape (2, parameters)."""
    limits = bounds(law, study.vehicle.box.nominal, study.spec.rate_hz)
    return np.array(limits, dtype=np.float64).T


def _beyond(limits: FloatArray, places: ArrayLike) -> float:
    """Return by how many steps of the lattice a candidate lies outside the bounds."""
    (low, high), at = limits, np.asarray(places, dtype=np.float64)
    return float(np.maximum(0.0, np.maximum(low - at, at - high)).sum())


def cost(judgement: Judgement) -> float:
    """Return what is minimised: the objective, or more than any where a demand is not met."""
    if judgement.violation:
        return _INFEASIBLE * (1.0 + judgement.violation)
    return judgement.objective


def evolved_cost(judgement: Judgement, violation_weight: float) -> float:
    """Return what the evolution minimises: the objective, raised by each nearly met demand.

    Weighted enough, its minimum meets all demands, and it has no step at their edge.
    """
    if violation_weight and math.isfinite(judgement.objective):
        return judgement.objective * (1.0 + violation_weight * judgement.violation)
    return cost(judgement)


def find(
    coarse: Study,
    fine: Study,
    law: str,
    progress: Progress,
    known: Sequence[Candidate] = (),
    kept: KeptCosts | None = None,
) -> Found:
    """Search the parameters of a law; deterministic for the seed of the specification.

    ``known``  candidates of which each takes the place of a start in the middle
    ``kept``   costs of an earlier search for the same that was stopped
    """

    starts = coarse.spec.search.starts

    def show_coarse(costs: Collection[float]) -> None:
        progress(_COARSE_SHARE * begun / starts, min(costs))

    def show_fine(costs: Collection[float]) -> None:
        left = 0.5 ** (len(costs) / _HALVED_AFTER)
        progress(1.0 - (1.0 - _COARSE_SHARE) * left, min(costs))

    kept = KeptCosts() if kept is None else kept
    lattice = _Lattice(coarse, law, kept, show_coarse, None)
    finely = _Lattice(fine, law, kept, show_fine, coarse)
    begun, judged, ended = 0, 0, True
    reached = 0.5 * bounds_of(coarse, law).sum(axis=0)
    try:
        for start in range(starts):
            begun, before = start + 1, judged
            near = known[start] if start < len(known) else None
            weight = coarse.spec.search.violation_weight
            evolution = _evolution(
                coarse, law, start, progress, kept, near=near, violation_weight=weight
            )
            for generation in evolution:
                reached, judged = generation.best, before + generation.judged
            descend(lattice.cost, _nearest(lattice, law, reached))
        for candidate in known:
            lattice.cost(candidate)
        _judge_finely(lattice, finely)
        descend(finely.cost, finely.best()[0])
    except SearchStoppedError:
        ended = False
        lattice.show = finely.show = _nobody
        _nearest(lattice, law, reached)
        _judge_finely(lattice, finely)
    judged += len(lattice.known)
    best = finely.best()[0]
    with suppress(SearchStoppedError):
        progress(1.0, finely.known[best])
    if finely.known[best] < _INFEASIBLE and not confirm(fine, best).stable:
        for neighbour in neighbours(best):
            finely.cost(neighbour)
    for candidate in finely.best()[:_KEPT]:
        if finely.known[candidate] >= _INFEASIBLE:
            break
        confirmation = confirm(fine, candidate)
        if confirmation.stable:
            return Found(candidate, judge_candidate(fine, candidate), confirmation, judged, ended)
    return Found(best, judge_candidate(fine, best), None, judged, ended)


def _nearest(lattice: _Lattice, law: str, places: FloatArray) -> Candidate:
    """Return the best candidate next to places between those of the lattice."""
    rounded = product(*((int(np.floor(x)), int(np.ceil(x))) for x in places))
    return min((Candidate(law, corner) for corner in rounded), key=lattice.cost)


def _judge_finely(lattice: _Lattice, finely: _Lattice) -> None:
    """Judge the best of the coarse study by the fine one, until one meets all demands."""
    for candidate in lattice.best()[:_KEPT]:
        if finely.cost(candidate) < _INFEASIBLE:
            break


def _nobody(_costs: Collection[float]) -> None:
    """Ends a search without being stopped again."""


def find_any(
    study: Study, law: str, progress: Progress, kept: KeptCosts | None = None, what: str = ""
) -> bool:
    """Whether an evolution from the first start meets all demands of a coarse study.

    ``what``  the study's name among the kept costs
    """
    kept = KeptCosts() if kept is None else kept
    return any(
        generation.best_cost < _INFEASIBLE
        for generation in _evolution(study, law, 0, progress, kept, what)
    )


def _evolution(
    study: Study,
    law: str,
    start: int,
    progress: Progress,
    kept: KeptCosts,
    what: str = "",
    near: Candidate | None = None,
    violation_weight: float = 0.0,
) -> Iterator[Generation]:
    """Yield the generations of an evolution between places of the lattice, until it settles.

    ``near``  where it begins, more narrowly; None for the middle of what is searched
    ``violation_weight``  as in ``evolved_cost``
    """
    table = study.spec.search
    limits = bounds_of(study, law)
    low, high = limits
    random = np.random.default_rng([table.seed, start])

    def cost_at(places: FloatArray, ceiling: float) -> float:
        beyond = _beyond(limits, places)
        if beyond:
            return _OUTSIDE * (1.0 + beyond)
        runs_up_to = NEARLY_MET if violation_weight or ceiling >= _INFEASIBLE else 0.0

        def judged() -> float:
            values = values_at(law, places)
            judgement = judge_law(study, law, values, runs_up_to, ceiling)
            return evolved_cost(judgement, violation_weight)

        return kept.cost((what, places.tolist()), judged, ceiling)

    points = table.points_per_parameter * len(low)
    middle, spread = 0.5 * (low + high), _FIRST_SPREAD * (high - low)
    if near is not None:
        middle, spread = np.array(near.places, dtype=np.float64), _SPREAD_NEAR * spread
    for generation in evolve(cost_at, middle, spread, points, random):
        yield generation
        done = (start + generation.number / table.generations) / table.starts
        progress(_COARSE_SHARE * done, generation.best_cost)
        if generation.spread < _SPREAD_MIN or generation.number >= table.generations:
            return


def descend(cost_of: Callable[[Candidate, float], float], start: Candidate) -> Candidate:
    """Go to the best neighbour on the lattice until none is better.

    ``cost_of``  of a candidate; its second argument is a ceiling, to which it may round up
    """
    least = cost_of(start, math.inf)
    while True:
        best = min(neighbours(start), key=lambda candidate: cost_of(candidate, least))
        if cost_of(best, least) >= least:
            return start
        start, least = best, cost_of(best, least)


def neighbours(candidate: Candidate) -> Iterator[Candidate]:
    """Yield the candidates that differ by a step in one parameter or in two."""
    indices, both_ways = range(len(candidate.places)), (-1, 1)
    for index, steps in product(indices, both_ways):
        yield candidate.moved(index, steps)
    for (first, second), one, two in product(combinations(indices, 2), both_ways, both_ways):
        yield candidate.moved(first, one).moved(second, two)
