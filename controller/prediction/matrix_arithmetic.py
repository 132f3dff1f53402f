"""Products, quotients and powers of small matrices, of + − × ÷ in a fixed order.

A law's design must have the same bits on every processor. The library behind numpy's ``@`` and
``linalg`` adds in a different order on each kind of processor. Here each number results from one
operation on two others, whose rounding IEEE 754 defines. A stack of matrices, shape (..., n, m),
costs hardly more than one.
"""

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
