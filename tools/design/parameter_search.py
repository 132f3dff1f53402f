"""Finds the parameters of a law: an evolution strategy, then descent on the lattice.

While a demand is not met, the cost is how far it is from being met. So the search first finds the
feasible set, and then minimises the objective in it. The evolution works on the logarithms of the
parameters and is judged by the coarse study. Its result is moved to the lattice. From there the
search goes to better neighbours until there is none, judged first by the coarse study, then by the
fine one. The result is the best point of the lattice whose stability the eigenvalues confirm.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from itertools import combinations, product
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...controller.analysis.sampled_loop import SampledLoop
from ...runtime.array_types import FloatArray
from ...runtime.node import NS_PER_MS
from .demands import Judgement, Study, judge_candidate, judge_law
from .evolution import Generation, evolve
from .law_parameters import Candidate, bounds, controller_settings, designs, values_at
from .loop_figures import behind_lag

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

_COARSE_SHARE = 0.75
"""How much of a search is by the coarse study, at most."""
_HALVED_AFTER = 150.0
"""Candidates of the fine study after which half of the rest of the progress has been shown."""

Progress = Callable[[float, float], None]
"""Called with the share of the search that is done at most, and the best cost so far."""


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
    """

    candidate: Candidate
    judgement: Judgement
    confirmation: Confirmation | None
    judged: int

    @property
    def feasible(self) -> bool:
        """Whether all demands are met."""
        return self.confirmation is not None and self.confirmation.stable


class _Lattice:
    """Judges each candidate of the lattice once; ``show`` is called with the costs so far.

    One outside the bounds is not judged: no filter may be at or above the Nyquist frequency.
    """

    def __init__(self, study: Study, law: str, show: Callable[[Collection[float]], None]) -> None:
        self._study = study
        self._bounds = bounds_of(study, law)
        self._show = show
        self.known: dict[Candidate, float] = {}

    def cost(self, candidate: Candidate) -> float:
        if candidate not in self.known:
            beyond = _beyond(self._bounds, candidate.places)
            judged = 0.0 if beyond else cost(judge_candidate(self._study, candidate))
            self.known[candidate] = _OUTSIDE * (1.0 + beyond) if beyond else judged
            self._show(self.known.values())
        return self.known[candidate]

    def best(self) -> list[Candidate]:
        return sorted(self.known, key=lambda candidate: (self.known[candidate], candidate))


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


def find(
    coarse: Study, fine: Study, law: str, progress: Progress, known: Sequence[Candidate] = ()
) -> Found:
    """Search the parameters of a law; deterministic for the seed of the specification.

    ``known``  candidates from which the search goes on where they are better
    """

    def show_fine(costs: Collection[float]) -> None:
        left = 0.5 ** (len(costs) / _HALVED_AFTER)
        progress(1.0 - (1.0 - _COARSE_SHARE) * left, min(costs))

    lattice, judged = _Lattice(coarse, law, lambda _costs: None), 0
    for start in range(coarse.spec.search.starts):
        *_, last = _evolution(coarse, law, start, progress)
        judged += last.judged
        rounded = product(*((int(np.floor(x)), int(np.ceil(x))) for x in last.best))
        nearest = min((Candidate(law, corner) for corner in rounded), key=lattice.cost)
        descend(lattice.cost, nearest)
    for candidate in known:
        if lattice.cost(candidate) < lattice.cost(lattice.best()[0]):
            descend(lattice.cost, candidate)
    judged += len(lattice.known)
    finely = _Lattice(fine, law, show_fine)
    for candidate in lattice.best()[:_KEPT]:
        if finely.cost(candidate) < _INFEASIBLE:
            break
    descend(finely.cost, finely.best()[0])
    for candidate in finely.best()[:_KEPT]:
        if finely.known[candidate] >= _INFEASIBLE:
            break
        confirmation = confirm(fine, candidate)
        if confirmation.stable:
            return Found(candidate, judge_candidate(fine, candidate), confirmation, judged)
    best = finely.best()[0]
    return Found(best, judge_candidate(fine, best), None, judged)


def find_any(study: Study, law: str, progress: Progress) -> bool:
    """Whether an evolution from the first start meets all demands of a coarse study."""
    return any(
        generation.best_cost < _INFEASIBLE for generation in _evolution(study, law, 0, progress)
    )


def _evolution(study: Study, law: str, start: int, progress: Progress) -> Iterator[Generation]:
    """Yield the generations of an evolution between places of the lattice, until it settles."""
    table = study.spec.search
    limits = bounds_of(study, law)
    low, high = limits
    random = np.random.default_rng([table.seed, start])

    def cost_at(places: FloatArray) -> float:
        beyond = _beyond(limits, places)
        if beyond:
            return _OUTSIDE * (1.0 + beyond)
        return cost(judge_law(study, law, values_at(law, places)))

    points = table.points_per_parameter * len(low)
    middle, spread = 0.5 * (low + high), _FIRST_SPREAD * (high - low)
    for generation in evolve(cost_at, middle, spread, points, random):
        done = (start + generation.number / table.generations) / table.starts
        progress(_COARSE_SHARE * done, generation.best_cost)
        yield generation
        if generation.spread < _SPREAD_MIN or generation.number >= table.generations:
            return


def descend(cost_of: Callable[[Candidate], float], start: Candidate) -> Candidate:
    """Go to the best neighbour on the lattice until none is better."""
    while True:
        best = min(neighbours(start), key=cost_of)
        if cost_of(best) >= cost_of(start):
            return start
        start = best


def neighbours(candidate: Candidate) -> Iterator[Candidate]:
    """Yield the candidates that differ by a step in one parameter or in two."""
    indices, both_ways = range(len(candidate.places)), (-1, 1)
    for index, steps in product(indices, both_ways):
        yield candidate.moved(index, steps)
    for (first, second), one, two in product(combinations(indices, 2), both_ways, both_ways):
        yield candidate.moved(first, one).moved(second, two)
