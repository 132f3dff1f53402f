"""Discrete algebraic Riccati equation by doubling, for gains of filters and of feedback.

    X = Q + Aᵀ X (1 + B R⁻¹ Bᵀ X)⁻¹ A

Each step doubles the horizon (structure-preserving doubling algorithm: Anderson, Second-order
convergent algorithms for the steady-state Riccati equation, Int. J. Control 28, 1978), so that a
random walk as slow as hours settles in some twenty steps. Design time only; scipy is not for live
programs.
"""

import numpy as np
from numpy.typing import NDArray

_DOUBLINGS = 60
_SETTLED = 1e-13

Matrix = NDArray[np.float64]


def solve_riccati(a: Matrix, b: Matrix, q: Matrix, r: Matrix) -> Matrix:
    """Return the stabilising X, shape (n, n), of A (n, n), B (n, m), Q (n, n) and R (m, m).

    Raises ValueError where the doubling does not settle: what cannot be steered grows by itself.
    """
    identity = np.eye(len(a))
    transition, acting = a, b @ np.linalg.solve(r, b.T)
    g, h = acting, q
    with np.errstate(over="ignore", invalid="ignore"):  # of what does not settle
        for _ in range(_DOUBLINGS):
            inverse = np.linalg.inv(identity + g @ h)
            after = h + a.T @ h @ inverse @ a
            g = g + a @ inverse @ g @ a.T
            a = a @ inverse @ a
            change = float(np.abs(after - h).max())
            h = 0.5 * (after + after.T)
            if not np.isfinite(h).all() or not np.isfinite(g).all():
                break
            if change <= _SETTLED * float(np.abs(h).max()):
                closed = np.linalg.solve(identity + acting @ h, transition)
                if np.abs(np.linalg.eigvals(closed)).max() < 1.0:
                    return h
                break  # what grows costs nothing, and is left to grow
    raise ValueError("the Riccati equation has no stabilising solution for these settings")


def feedback_gain(a: Matrix, b: Matrix, q: Matrix, r: Matrix) -> Matrix:
    """Return K, shape (m, n), of u = -K x that costs least in xᵀ Q x + uᵀ R u."""
    x = solve_riccati(a, b, q, r)
    return np.asarray(np.linalg.solve(r + b.T @ x @ b, b.T @ x @ a), dtype=np.float64)


def filter_gain(a: Matrix, h: Matrix, q: Matrix, r: Matrix) -> Matrix:
    """Return K, shape (n, m), of x ← x + K (z - H x) after the measurement, once it has settled.

    ``q`` and ``r`` are the covariances of the state's noise over a period and of the measurement.
    """
    p = solve_riccati(a.T, h.T, q, r)
    return np.asarray(np.linalg.solve(r + h @ p @ h.T, h @ p).T, dtype=np.float64)
