"""Points of a study: which levels of the factors are run together.

    grid              every combination, in a fixed order
    latin_hypercube   ``count`` points, one in each of ``count`` layers of every factor
    sobol             ``count`` points of a scrambled Sobol sequence; best as a power of two

The last factor of a grid varies fastest. Points are numbered, and each follows from its number.
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ...runtime.array_types import FloatArray
from .factors import Factor, Level
from .study_file import REPLICATES_MAX, SamplingKind, SamplingSettings


class Design(NamedTuple):
    """The points of a study.

    ``uniforms``  shape (points, factors), in (0, 1); None for a grid
    """

    factors: tuple[Factor, ...]
    points: int
    uniforms: FloatArray | None

    def point(self, index: int) -> tuple[Level, ...]:
        """Return the level of every factor at a point."""
        if self.uniforms is not None:
            row = self.uniforms[index].tolist()
            return tuple(factor.at(u) for factor, u in zip(self.factors, row, strict=True))
        picked = []
        for factor in reversed(self.factors):
            levels = factor.levels or ()
            index, place = divmod(index, len(levels))
            picked.append(levels[place])
        return tuple(reversed(picked))


def make_design(factors: tuple[Factor, ...], sampling: SamplingSettings) -> Design:
    """Return the points of a study."""
    if sampling.kind is SamplingKind.GRID:
        return Design(factors, math.prod(len(factor.levels or ()) for factor in factors), None)
    count = sampling.count or 1
    if not factors:
        return Design(factors, 1, None)
    return Design(factors, count, _uniforms(sampling, count, len(factors)))


@lru_cache(REPLICATES_MAX)
def replicate_seed(study_seed: int, replicate: int) -> int:
    """Return the seed of the runs of one replicate, from 0 to 2⁶³ − 1.

    It depends on nothing else, so all controllers meet the same network at all points: two rows of
    a replicate differ because of their factors, not by chance.
    """
    words = np.random.SeedSequence((study_seed, replicate)).generate_state(1, np.uint64)
    return int(words[0]) >> 1


def _uniforms(sampling: SamplingSettings, count: int, factors: int) -> FloatArray:
    from scipy.stats import qmc

    rng = np.random.default_rng(sampling.seed)  # scipy 1.14 calls it seed
    if sampling.kind is SamplingKind.LATIN_HYPERCUBE:
        points = qmc.LatinHypercube(factors, seed=rng).random(count)
    else:
        # A balanced sequence needs a power of two points; those beyond count are cut off.
        points = qmc.Sobol(factors, seed=rng).random_base2(math.ceil(math.log2(count)))[:count]
    return np.clip(np.asarray(points, dtype=np.float64), 2.0**-54, 1.0 - 2.0**-53)
