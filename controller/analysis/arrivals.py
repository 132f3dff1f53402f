"""When commands arrive if each draws its own, independent latency; in whole control periods.

With a share p of all commands lost, those that have not arrived after b-1 periods arrive at the
next with probability

    h_b = (1 - p) (F_b - F_(b-1)) / (1 - (1 - p) F_(b-1)),     F_b = P(latency ≤ b periods)

A continuous latency is rounded to the nearest whole period, which keeps its mean. A latency of zero
arrives in the very period it is sent in.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ...runtime.array_types import FloatArray
from ...runtime.node import NS_PER_S

AGE_PROBABILITY_MIN = 1e-9
"""Rarer events are neglected: shorter latencies, and longer waits for any command."""

LatencyCdf = Callable[[FloatArray], FloatArray]
"""P(latency ≤ t) for latencies t [s], any shape."""


class Arrivals(NamedTuple):
    """When commands arrive.

    ``cdf``   P(latency ≤ b periods) for b = 0, 1, ..., ascending; then as the last
    ``loss``  share of commands that never arrive, 0 to below 1
    """

    cdf: FloatArray
    loss: float = 0.0


def gamma_cdf(mean_s: float, spread_s: float) -> LatencyCdf:
    """Return the gamma distribution with a mean and a standard deviation > 0 [s]."""
    from scipy.special import gammainc

    shape = (mean_s / spread_s) ** 2
    return lambda t: np.asarray(gammainc(shape, np.maximum(t, 0.0) * shape / mean_s))


def constant_cdf(mean_s: float) -> LatencyCdf:
    """Return the latency that does not vary."""
    return lambda t: np.where(t >= mean_s * (1.0 - 1e-12), 1.0, 0.0)


def arrivals(cdf: LatencyCdf, period_ns: int, loss: float = 0.0) -> Arrivals:
    """Return the arrivals of a latency rounded to whole periods, as far as its tail matters."""
    count = 64
    while True:
        values = cdf((np.arange(count, dtype=np.float64) + 0.5) * (period_ns / NS_PER_S))
        if values[-1] >= 1.0 - 1e-3 * AGE_PROBABILITY_MIN or count >= 1 << 16:
            needed = int(np.searchsorted(values, 1.0 - 1e-3 * AGE_PROBABILITY_MIN)) + 1
            return Arrivals(values[:needed], loss)
        count *= 2


def hazards_by_age(when: Arrivals) -> tuple[FloatArray, int]:
    """Return h_b for the ages to follow, shape (ages,), and the largest of them.

    Followed are commands up to the age at which, but for AGE_PROBABILITY_MIN, a newer one has come.
    Raises ValueError where none ever comes.
    """
    arrived = np.where(when.cdf < AGE_PROBABILITY_MIN, 0.0, when.cdf) * (1.0 - when.loss)
    if not len(arrived) or not arrived[-1] > 0.0:
        raise ValueError("no command ever arrives")
    still_out, oldest = 1.0, -1
    while still_out >= AGE_PROBABILITY_MIN:  # none of the ages 0 to oldest has arrived
        oldest += 1
        still_out *= 1.0 - arrived[min(oldest, len(arrived) - 1)]
    ages = oldest + 1
    padded = np.concatenate([[0.0], arrived, np.full(max(0, ages - len(arrived)), arrived[-1])])
    out_before = 1.0 - padded[:-1]
    hazards = np.divide(
        np.diff(padded), out_before, out=np.ones_like(out_before), where=out_before > 0.0
    )
    return hazards[:ages], oldest
