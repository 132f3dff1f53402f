"""Latency distributions as quantile functions: latency = quantile(u), u uniform in (0, 1).

Randomness is an input, so that one stream of u means the same sequence of good and bad frames to
every distribution: where one quantile function lies above another, every frame comes later.

    mean_s     m   mean of the distribution                 [s]
    spread_s   s   its standard deviation                   [s]

    constant    m
    uniform     m + √3 s (2u − 1)
    normal      m + s Φ⁻¹(u)
    lognormal   exp(μ + σ Φ⁻¹(u)),   σ² = ln(1 + s²/m²),   μ = ln m − σ²/2
    gamma       θ P⁻¹(k, u),         k = m²/s²,            θ = s²/m

A latency is never negative: what uniform and normal put below zero is set to zero, which raises
the mean and lowers the spread a little where s is not small against m (normal, m = 80 ms,
s = 30 ms: by 0.04 ms). Lognormal and gamma need no clipping and keep both exactly.
"""

from collections.abc import Callable
from enum import StrEnum
from math import exp, log, sqrt
from statistics import NormalDist

RESOLUTION_S = 1e-9
"""Resolution of latencies. A mean or spread below it counts as 0, so that no ratio overflows."""

_STANDARD_NORMAL = NormalDist()
_SQRT_3 = sqrt(3.0)


class Distribution(StrEnum):
    """Shape of a latency; the names are those of the wire's LatencyModel."""

    CONSTANT = "constant"
    UNIFORM = "uniform"
    NORMAL = "normal"
    LOGNORMAL = "lognormal"
    GAMMA = "gamma"


def lognormal_quantile(u: float, mean_s: float, spread_s: float) -> float:
    """Return the quantile [s] of the lognormal distribution."""
    if min(mean_s, spread_s) < RESOLUTION_S:
        return mean_s  # a positive variable with mean zero is zero
    variance = log(1.0 + (spread_s / mean_s) ** 2)
    return mean_s * exp(sqrt(variance) * _STANDARD_NORMAL.inv_cdf(u) - 0.5 * variance)


def gamma_quantile(u: float, mean_s: float, spread_s: float) -> float:
    """Return the quantile [s] of the gamma distribution."""
    # Only this distribution needs scipy, whose import would double the start-up time.
    from scipy.special import gammaincinv

    if min(mean_s, spread_s) < RESOLUTION_S:
        return mean_s
    shape = (mean_s / spread_s) ** 2
    return mean_s / shape * float(gammaincinv(shape, u))


Quantile = Callable[[float, float, float], float]

QUANTILES: dict[Distribution, Quantile] = {
    Distribution.CONSTANT: lambda _u, mean_s, _spread_s: mean_s,
    Distribution.UNIFORM: lambda u, mean_s, spread_s: max(
        0.0, mean_s + _SQRT_3 * spread_s * (2.0 * u - 1.0)
    ),
    Distribution.NORMAL: lambda u, mean_s, spread_s: max(
        0.0, mean_s + spread_s * _STANDARD_NORMAL.inv_cdf(u)
    ),
    Distribution.LOGNORMAL: lognormal_quantile,
    Distribution.GAMMA: gamma_quantile,
}
"""Quantile functions ``(u, mean_s, spread_s) -> latency_s``."""
