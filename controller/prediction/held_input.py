"""Response of a linear system to a held input: the exact step from one instant to another.

Design time only, and without scipy, which live programs do not import.
"""

from math import factorial, frexp

import numpy as np

from .matrix_arithmetic import Matrix, product

_BLOCKS = 5
"""Blocks of four terms of the series: for a norm of at most 1/2 the remainder is below 1e-24."""


def held_over(a: Matrix, b: Matrix, time_s: float | Matrix) -> tuple[Matrix, Matrix]:
    """Return e^(At), and the response of the state to a unit input during t.

    A (..., n, n) and b (..., n) may be stacks of systems, and t a stack of times, shape (...).
    """
    order = b.shape[-1]
    both = np.zeros((*a.shape[:-2], order + 1, order + 1))
    both[..., :order, :order] = a
    both[..., :order, order] = b
    exponential = _exponential(both * np.asarray(time_s)[..., np.newaxis, np.newaxis])
    return exponential[..., :order, :order], exponential[..., :order, order]


def _exponential(matrix: Matrix) -> Matrix:
    """Return e^M by Taylor series, four terms at a time, with scaling and squaring."""
    norm = float(np.abs(matrix).sum(axis=-1).max(initial=0.0))
    squarings = max(0, frexp(norm)[1] + 1)
    scaled = matrix / 2.0**squarings
    square = product(scaled, scaled)
    powers = (np.eye(matrix.shape[-1]), scaled, square, product(square, scaled))
    fourth, total = product(square, square), np.zeros_like(matrix)
    for block in reversed(range(_BLOCKS)):
        if block < _BLOCKS - 1:
            total = product(total, fourth)
        for power in reversed(range(4)):
            total = total + powers[power] / factorial(4 * block + power)
    for _ in range(squarings):
        total = product(total, total)
    return total
