"""CMA-ES, the covariance matrix adaptation evolution strategy: a minimum without derivatives.

    x_i = m + σ B D z_i,  z_i ~ N(0, I),   C = B D² Bᵀ                 a generation of λ points
    m ← Σ w_i x_(i:λ)                                                 the better half, weighted
    p_σ, p_c                                                          paths the mean has taken
    C ← (1 - c_1 - c_μ) C + c_1 p_c p_cᵀ + c_μ Σ w_i y_i y_iᵀ,  y_i = (x_(i:λ) - m)/σ
    σ ← σ exp((c_σ/d_σ)(|p_σ|/E|N(0,I)| - 1))

After N. Hansen, "The CMA Evolution Strategy: A Tutorial", arXiv:1604.00772, with its default
constants. Only the order of the costs matters, so a demand that is not met may cost any amount
above all candidates that meet it. C learns the narrow ridge along which gains and cut-offs can be
traded for one another; other searches stop where they first meet that ridge.

Principal axes of a covariance by cyclic Jacobi rotations, in a fixed order on every processor.

    C = B diag(variances) Bᵀ

A library's eigenvectors have signs and last bits that depend on the processor, and a search guided
by them ends elsewhere. The matrices are as small as a law has parameters.
"""

import math
from collections.abc import Callable, Iterator
from math import copysign, sqrt
from typing import NamedTuple

import numpy as np

from ....controller.prediction.matrices import product
from ....runtime.array_types import FloatArray

_SWEEPS_MAX = 50
_ROTATED_MIN = 1e-16
"""Share of the two variances' geometric mean; smaller covariances change neither variance."""


class Constants(NamedTuple):
    """Constants of the strategy, for a number of dimensions and of points in a generation."""

    weights: FloatArray  # of the better half, falling, their sum 1
    mass: float  # μ_eff
    c_sigma: float
    d_sigma: float
    c_path: float
    c_one: float
    c_mu: float
    length: float  # E|N(0,I)|


class Generation(NamedTuple):
    """State of the evolution after a generation; ``spread`` is the largest std. deviation."""

    number: int
    judged: int
    best: FloatArray
    best_cost: float
    spread: float


def constants(dimensions: int, points: int) -> Constants:
    """Return Hansen's defaults (table 1, without negative weights)."""
    n, half = float(dimensions), points // 2
    weights = np.array([math.log((points + 1) / 2.0 / place) for place in range(1, half + 1)])
    weights = weights / weights.sum()
    mass = float(1.0 / np.square(weights).sum())
    c_sigma = (mass + 2.0) / (n + mass + 5.0)
    c_one = 2.0 / ((n + 1.3) ** 2 + mass)
    return Constants(
        weights,
        mass,
        c_sigma,
        1.0 + 2.0 * max(0.0, math.sqrt((mass - 1.0) / (n + 1.0)) - 1.0) + c_sigma,
        (4.0 + mass / n) / (n + 4.0 + 2.0 * mass / n),
        c_one,
        min(1.0 - c_one, 2.0 * (mass - 2.0 + 1.0 / mass) / ((n + 2.0) ** 2 + mass)),
        math.sqrt(n) * (1.0 - 1.0 / (4.0 * n) + 1.0 / (21.0 * n**2)),
    )


def evolve(
    cost: Callable[[FloatArray, float], float],
    start: FloatArray,
    deviation: FloatArray,
    points: int,
    random: np.random.Generator,
) -> Iterator[Generation]:
    """Yield generation after generation, without end.

    ``cost``       of a point; its second argument is a ceiling. A point above that is in the worse
                   half of its generation, so any value above it does as well as the true cost
    ``start``      where the first generation is centred, shape (n,)
    ``deviation``  and how far it is spread in each coordinate, shape (n,)
    """
    c = constants(len(start), points)
    mean, sigma = start.astype(np.float64), 1.0
    covariance = np.diag(np.square(deviation))
    path_sigma, path = np.zeros_like(mean), np.zeros_like(mean)
    best, best_cost, number = mean, math.inf, 0
    variances, basis = principal_axes(covariance)
    while True:
        number += 1
        scales = np.sqrt(np.maximum(variances, 0.0))
        steps = product(random.standard_normal((points, len(mean))) * scales, basis.T)
        samples = mean + sigma * steps
        costs = _costs(cost, samples, len(c.weights))
        order = np.argsort(costs, kind="stable")
        if costs[order[0]] < best_cost:
            best, best_cost = samples[order[0]], float(costs[order[0]])
        chosen = steps[order[: len(c.weights)]]
        step = product(c.weights[np.newaxis], chosen)[0]
        mean = mean + sigma * step
        along = product(step[np.newaxis], basis) / np.maximum(scales, 1e-300)
        whitened = product(along, basis.T)[0]
        path_sigma = (1.0 - c.c_sigma) * path_sigma
        path_sigma += math.sqrt(c.c_sigma * (2.0 - c.c_sigma) * c.mass) * whitened
        size = math.hypot(*path_sigma)
        expected = math.sqrt(1.0 - (1.0 - c.c_sigma) ** (2 * number)) * c.length
        follows = size / expected < 1.4 + 2.0 / (len(mean) + 1.0)
        path = (1.0 - c.c_path) * path
        if follows:
            path += math.sqrt(c.c_path * (2.0 - c.c_path) * c.mass) * step
        kept = 1.0 - c.c_one - c.c_mu
        if not follows:
            kept += c.c_one * c.c_path * (2.0 - c.c_path)
        covariance = (
            kept * covariance
            + c.c_one * np.outer(path, path)
            + c.c_mu * product(chosen.T * c.weights, chosen)
        )
        sigma *= math.exp(min(1.0, c.c_sigma / c.d_sigma * (size / c.length - 1.0)))
        variances, basis = principal_axes(covariance)
        spread = sigma * math.sqrt(float(variances.max()))
        yield Generation(number, number * points, best, best_cost, spread)


def _costs(
    cost: Callable[[FloatArray, float], float], samples: FloatArray, half: int
) -> FloatArray:
    """Return the costs of a generation; the ceiling is the worst cost of its better half so far."""
    costs: list[float] = []
    for sample in samples:
        ceiling = sorted(costs)[half - 1] if len(costs) >= half else math.inf
        costs.append(cost(sample, ceiling))
    return np.array(costs)


def principal_axes(covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the variances, shape (n,), and B, shape (n, n), whose columns are the axes."""
    order = len(covariance)
    c, b = covariance.tolist(), np.eye(order).tolist()
    pairs = [(p, q) for p in range(order) for q in range(p + 1, order)]
    for _ in range(_SWEEPS_MAX):
        turned = [
            (p, q) for p, q in pairs if abs(c[p][q]) > _ROTATED_MIN * sqrt(abs(c[p][p] * c[q][q]))
        ]
        if not turned:
            break
        for p, q in turned:
            if c[p][q] == 0.0:
                continue
            slope = (c[q][q] - c[p][p]) / (2.0 * c[p][q])
            tangent = copysign(1.0, slope) / (abs(slope) + sqrt(slope * slope + 1.0))
            cos = 1.0 / sqrt(tangent * tangent + 1.0)
            sin = tangent * cos
            for row in (*c, *b):
                row[p], row[q] = cos * row[p] - sin * row[q], sin * row[p] + cos * row[q]
            c[p], c[q] = (
                [cos * x - sin * y for x, y in zip(c[p], c[q], strict=True)],
                [sin * x + cos * y for x, y in zip(c[p], c[q], strict=True)],
            )
            c[p][q] = c[q][p] = 0.0
    return np.array([c[index][index] for index in range(order)]), np.array(b)
