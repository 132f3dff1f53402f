"""Bounds from sorted break-points, right for any distribution.

With the break-points of n seeds in order, b_(1) ≤ ... ≤ b_(n), whatever their distribution:

    P(b_(r) is at most its q-quantile) = P(Bin(n, q) ≥ r)

so b_(r) with the largest r for which P(Bin(n, 1 - share) ≤ r - 1) ≤ 1 - CONFIDENCE is a bound: at
b_(r) at least ``share`` of all seeds hold, with that confidence. (That is the bound of Clopper and
Pearson: with 29 seeds of which all hold at b_(1), share ≥ 0.05^(1/29) = 0.90.) The interval for the
median comes from the same law at q = 1/2.
"""

import math

import numpy as np


def held_bound(ascending: tuple[float, ...], share: float, confidence: float) -> float:
    """Return where at least ``share`` of all seeds hold, with ``confidence``; NaN if unknown."""
    from scipy.stats import binom

    ranks = np.arange(1, len(ascending) + 1)
    fits = binom.cdf(ranks - 1, len(ascending), 1.0 - share) <= 1.0 - confidence
    return ascending[int(np.count_nonzero(fits)) - 1] if fits[0] else math.nan


def median_interval(ascending: tuple[float, ...], confidence: float) -> tuple[float, float]:
    """Return an interval that holds the median with ``confidence``; infinite for too few."""
    from scipy.stats import binom

    count = len(ascending)
    rank = int(binom.ppf(0.5 * (1.0 - confidence), count, 0.5))
    while rank > 0 and 2.0 * binom.cdf(rank - 1, count, 0.5) > 1.0 - confidence:
        rank -= 1
    return (ascending[rank - 1], ascending[count - rank]) if rank else (-math.inf, math.inf)
