"""Small matrices: products, quotients, powers and the zero-order hold, of + − × ÷ in a fixed order.

A law's design must have the same bits on every processor. The library behind numpy's ``@`` and
``linalg`` adds in a different order on each kind of processor. Here each number results from one
operation on two others, whose rounding IEEE 754 defines. A stack of matrices, shape (..., n, m),
costs hardly more than one.
"""

from math import factorial, frexp

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]


def product(a: Matrix, b: Matrix) -> Matrix:
    """Return A B, shapes (..., n, k) and (..., k, m)."""
    if a.ndim == b.ndim == 2:  # in few calls; all terms of a stack at once would be slower
        last: Matrix = np.add.accumulate(a.T[:, :, np.newaxis] * b[:, np.newaxis, :])[-1]
        return last
    total: Matrix = a[..., :, :1] * b[..., :1, :]
    for k in range(1, a.shape[-1]):
        total = total + a[..., :, k : k + 1] * b[..., k : k + 1, :]
    return total


def transposed(a: Matrix) -> Matrix:
    """Return Aᵀ."""
    return np.swapaxes(a, -1, -2)


def quotient(a: Matrix, b: Matrix) -> Matrix:
    """Return A⁻¹ B by elimination with pivots, shapes (n, n) or (..., n, n), and (..., n, m).

    For a singular A the result is not finite.
    """
    order = a.shape[-1]
    rows = np.concatenate((np.broadcast_to(a, (*b.shape[:-1], order)), b), axis=-1)
    rows = rows.reshape(-1, order, rows.shape[-1])
    each = np.arange(len(rows))
    for k in range(order):
        pivot = k + np.abs(rows[:, k:, k]).argmax(axis=1)
        rows[each, k], rows[each, pivot] = rows[each, pivot], rows[each, k]
        rows[:, k] /= rows[:, k, k : k + 1].copy()
        share = rows[:, :, k : k + 1].copy()
        share[:, k] = 0.0
        rows -= share * rows[:, k : k + 1]
    return rows[:, :, order:].reshape(b.shape)


def contracts(a: Matrix, squarings: int) -> NDArray[np.bool_]:
    """Whether one of ``squarings`` powers A, A², A⁴ ... has norm < 1/2: |eigenvalues| below 1."""
    has_shrunk = np.zeros(a.shape[:-2], dtype=np.bool_)
    for _ in range(squarings):
        has_shrunk |= np.abs(a).sum(axis=-1).max(axis=-1) < 0.5
        if has_shrunk.all():
            break
        a = product(a, a)
    return has_shrunk


_BLOCKS = 5
"""Blocks of four terms of the series: for a norm of at most 1/2 the remainder is below 1e-24."""


def zero_order_hold(a: Matrix, b: Matrix, time_s: float | Matrix) -> tuple[Matrix, Matrix]:
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
