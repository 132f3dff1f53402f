"""Search for the parameters of a law: an evolution, judged coarsely, then finely.

While a demand is not met, the cost is how far it is from being met, so that the search first finds
what meets all demands. A demand that is nearly met raises the objective instead: enough for the
minimum to meet it, and without a step at its edge. The result is the best point that meets all
demands of the fine bench.
"""

import math
from typing import NamedTuple

from ....controller.analysis.sampled_loop import SampledLoop
from ....controller.analysis.stable_delays import least_margin_ns
from ....controller.laws.law_from_settings import design_law
from ....runtime.node import NS_PER_MS
from ..demands import Bench, Judgement, judge_law
from ..loop_figures import behind_lag
from .evolution import SPREAD, Search, Values
from .law_parameters import bounds, controller_settings

DELAY_NS_MAX = 2_000 * NS_PER_MS
_INFEASIBLE = 1e6
"""Cost of a violation of 0; no objective comes near."""
_VIOLATION_WEIGHT = 10.0
"""Share of the objective by which a violation of 1 raises it."""
_SPREAD_NEAR = 0.2 * SPREAD
"""Of an evolution that begins near a known design."""
_FAST_CDOB_RAD_S = 0.1
"""Below and above this a CDOB has designs of its own; the last start looks above it alone."""
_FINE_GENERATIONS = 30
"""Of the evolution that is judged finely, where the coarse one found what misses a demand."""
_CONFIRMED_MAX = 60
"""How many of the best are judged finely until one meets all demands."""


class Confirmation(NamedTuple):
    """Stability of a law.

    ``decay_1_s``         of the slowest mode over all corners and delays of the range [1/s]
    ``stable_up_to_ns``   the largest of 0, step, 2 step, ... up to which every corner is stable
    ``with_lag_up_to_ns``  with the lag of the steering too; None where none is specified
    """

    decay_1_s: float
    stable_up_to_ns: int
    with_lag_up_to_ns: int | None


def confirm(bench: Bench, law: str, values: Values) -> Confirmation:
    """Return how far a law's stability reaches."""
    spec = bench.spec
    design = design_law(controller_settings(spec, bench.vehicle, law, values))
    step_ns = round(spec.delay.step_ms * NS_PER_MS)

    def loops(lag_s: float) -> list[SampledLoop]:
        models = [behind_lag(model, lag_s) for model in bench.vehicle.models]
        return [SampledLoop(design, model, spec.period_ns) for model in models]

    def stable_up_to_ns(lag_s: float) -> int:
        return least_margin_ns(loops(lag_s), DELAY_NS_MAX) // step_ns * step_ns

    decays_1_s = [loop.decay_1_s(delay_ns) for loop in loops(0.0) for delay_ns in spec.delays_ns]
    with_lag_ns = None if spec.actuator is None else stable_up_to_ns(spec.actuator.lag_s)
    return Confirmation(min(decays_1_s), stable_up_to_ns(0.0), with_lag_ns)


class Found(NamedTuple):
    """The outcome of a search.

    ``values``        the best parameters; the nearest to the demands where none meet them
    ``judgement``     of the fine bench
    ``confirmation``  None where not all demands are met
    ``judged``        how many sets of parameters were judged
    ``ended``         whether the search came to its end; otherwise this is its best so far
    """

    law: str
    values: Values
    judgement: Judgement
    confirmation: Confirmation | None
    judged: int
    ended: bool = True

    @property
    def feasible(self) -> bool:
        """Whether all demands are met."""
        return self.confirmation is not None


def cost(judgement: Judgement) -> float:
    """Return what is minimised: the objective, raised by each demand that is nearly met."""
    if math.isinf(judgement.objective):
        return _INFEASIBLE * (1.0 + judgement.violation)
    return judgement.objective * (1.0 + _VIOLATION_WEIGHT * judgement.violation)


def find(coarse: Bench, fine: Bench, law: str, until_s: float, near: Values | None = None) -> Found:
    """Search the parameters of a law; deterministic for the seed of the specification.

    ``until_s``  of the monotonic clock: then the best so far is taken
    ``near``     a known design, near which the first start begins
    """
    table = coarse.spec.search
    ranges = bounds(law, coarse.vehicle.vehicle.vehicle, coarse.spec.rate_hz)
    search = Search(lambda values: cost(judge_law(coarse, law, values)), ranges, until_s)
    for start in range(table.starts):
        if 0 < start == table.starts - 1 and "cdob" in ranges:
            search.search_between({**ranges, "cdob": (_FAST_CDOB_RAD_S, ranges["cdob"][1])})
        begins = (near, _SPREAD_NEAR) if near is not None and start == 0 else (None, SPREAD)
        search.evolve(table.seed + start, table.generations, *begins)
    found = _first_confirmed(fine, law, search)
    if search.ended and search.least < _INFEASIBLE and not found.feasible:
        search = Search(lambda values: cost(judge_law(fine, law, values)), ranges, until_s)
        search.evolve(table.seed, _FINE_GENERATIONS, found.values, _SPREAD_NEAR)
        found = _first_confirmed(fine, law, search)
    return found


def _first_confirmed(fine: Bench, law: str, search: Search) -> Found:
    """Return the best point that meets all demands; the best of the coarse bench if none does."""
    for values in search.best(_CONFIRMED_MAX):
        judgement = judge_law(fine, law, values)
        if not judgement.violation:
            confirmed = confirm(fine, law, values)
            return Found(law, values, judgement, confirmed, search.judged, search.ended)
    (values,) = search.best(1)
    return Found(law, values, judge_law(fine, law, values), None, search.judged, search.ended)
