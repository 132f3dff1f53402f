"""What a linear system makes of an input that is held: the exact step from one instant to another.

Design time only, and without scipy, which is not for live programs.
"""

import math

import numpy as np
from numpy.typing import NDArray

_TAYLOR_TERMS = 18
"""With a norm of at most 1/2 the first term left out is below 1e-22."""


def held_over(
    a: NDArray[np.float64], b: NDArray[np.float64], time_s: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return e^(At), and what a unit input during t adds to the state, b of shape (order,)."""
    order = len(b)
    both = np.zeros((order + 1, order + 1))
    both[:order, :order] = a
    both[:order, order] = b
    exponential = _exponential(both * time_s)
    return exponential[:order, :order], exponential[:order, order]


def _exponential(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return e^M by Taylor series with scaling and squaring; scipy's is not for live programs."""
    norm = float(np.abs(matrix).sum(axis=1).max())
    squarings = max(0, math.ceil(math.log2(norm)) + 1) if norm else 0
    scaled = matrix / 2.0**squarings
    term = total = np.eye(len(matrix))
    for index in range(1, _TAYLOR_TERMS):
        term = term @ scaled / index
        total = total + term
    for _ in range(squarings):
        total = total @ total
    return total
