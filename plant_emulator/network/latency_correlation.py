"""Correlation of the latencies of successive frames: an AR(1) process beneath their distribution.

The process moves the uniform that a latency is drawn from; the distribution stays what it was.
"""

from math import exp, sqrt
from statistics import NormalDist

_STANDARD_NORMAL = NormalDist()


def correlated_score(
    previous: float, u: float, elapsed_s: float, correlation_time_s: float
) -> float:
    """Advance the AR(1) process behind correlated latencies by one frame.

        z ← φ z + √(1 − φ²) Φ⁻¹(u),   φ = exp(−elapsed / correlation time)

    z stays standard normal, so `uniform_of_score(z)` is a uniform again and the distribution of
    the latencies stays what it was. For frames at a regular period this is AR(1) with the
    constant coefficient φ; tying φ to time gives messages of different periods, and frames sent
    at the same instant, the one state of the network that they share.
    """
    phi = exp(-elapsed_s / correlation_time_s)
    return phi * previous + sqrt(1.0 - phi * phi) * _STANDARD_NORMAL.inv_cdf(u)


def uniform_of_score(score: float) -> float:
    """Return Φ(z), kept off the ends of (0, 1)."""
    return min(max(_STANDARD_NORMAL.cdf(score), 2.0**-54), 1.0 - 2.0**-53)
