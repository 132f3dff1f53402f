"""CMA-ES: a search for the least cost without derivatives, on the logarithms of parameters.

The covariance matrix adaptation evolution strategy learns the narrow ridge along which gains and
cut-offs can be traded for one another; other searches stop where they first meet that ridge. Only
the order of the costs matters. The package ``cmaes`` computes it.

Every point is judged with numbers of few digits. So the values that are judged are those of the
preset, and nothing is rounded afterwards.
"""

import math
from collections.abc import Callable, Mapping
from time import monotonic

import numpy as np
from cmaes import CMA

from ....runtime.array_types import FloatArray

Values = dict[str, float]
"""Parameters by their keys."""
SPREAD = 0.25
"""Standard deviation of the first generation, as a share of the range."""
_SPREAD_MIN = 1e-3
"""An evolution that varies less has ended."""
_POINTS_PER_PARAMETER = 4


class _TimeIsUpError(Exception):
    """The time of a search is up."""


class Search:
    """All points that were judged, with their costs.

    ``ranges``   of each parameter, lowest and highest > 0
    ``until_s``  of the monotonic clock: after it only the first point is judged
    ``digits``   with which the parameters are judged

    ``ended``    whether all evolutions so far came to their end; False where the time was up
    """

    def __init__(
        self,
        cost: Callable[[Values], float],
        ranges: Mapping[str, tuple[float, float]],
        until_s: float = math.inf,
        digits: int = 3,
    ) -> None:
        self._cost, self._until_s, self.ended = cost, until_s, True
        self._keys = tuple(ranges)
        self.search_between(ranges)
        self._digits = digits
        self._costs: dict[tuple[float, ...], float] = {}

    def search_between(self, ranges: Mapping[str, tuple[float, float]]) -> None:
        """Set the ranges of the evolutions to come, of the same parameters."""
        self._low, self._high = np.log(np.array(list(ranges.values()))).T

    @property
    def judged(self) -> int:
        """How many points were judged."""
        return len(self._costs)

    @property
    def least(self) -> float:
        """The least cost so far."""
        return min(self._costs.values(), default=math.inf)

    def best(self, count: int) -> list[Values]:
        """Return the best points, the best first."""
        points = sorted(self._costs, key=lambda point: (self._costs[point], point))
        return [dict(zip(self._keys, point, strict=True)) for point in points[:count]]

    def _judge(self, values: Values) -> float:
        """Return the cost of a point, which is judged once; raises _TimeIsUpError."""
        point = tuple(values[key] for key in self._keys)
        if point not in self._costs:
            if self._costs and monotonic() > self._until_s:
                raise _TimeIsUpError
            self._costs[point] = self._cost(values)
        return self._costs[point]

    def evolve(
        self, seed: int, generations: int, near: Values | None = None, spread: float = SPREAD
    ) -> None:
        """Judge generations of points until these hardly differ, or the time is up.

        ``near``    where it begins; None: in the middle of the ranges
        ``spread``  of the first generation, as a share of the ranges
        """
        try:
            self._evolve(seed, generations, near, spread)
        except _TimeIsUpError:
            self.ended = False

    def _evolve(self, seed: int, generations: int, near: Values | None, spread: float) -> None:
        count = len(self._keys)
        middle = np.full(count, 0.5)
        if near is not None:
            self._judge(near)
            logarithms = np.log([near[key] for key in self._keys])
            middle = np.clip((logarithms - self._low) / (self._high - self._low), 0.0, 1.0)
        strategy = CMA(
            mean=middle,
            sigma=spread,
            bounds=np.tile([0.0, 1.0], (count, 1)),
            seed=seed,
            population_size=_POINTS_PER_PARAMETER * count,
        )
        for _ in range(generations):
            points = [strategy.ask() for _ in range(strategy.population_size)]
            strategy.tell([(point, self._judge(self._values(point))) for point in points])
            if float(np.ptp(points, axis=0).max()) < _SPREAD_MIN:
                return

    def _values(self, point: FloatArray) -> Values:
        parameters = np.exp(self._low + point * (self._high - self._low))
        return {
            key: float(f"{value:.{self._digits}g}")
            for key, value in zip(self._keys, parameters, strict=True)
        }
