"""Discrete algebraic Riccati equation by doubling, for gains of filters and of feedback.

    X = Q + Aᵀ X (1 + B R⁻¹ Bᵀ X)⁻¹ A

Each step doubles the horizon (structure-preserving doubling algorithm: Anderson, Second-order
convergent algorithms for the steady-state Riccati equation, Int. J. Control 28, 1978), so that a
random walk with a time scale of hours settles in some twenty steps. Design time only, and without
scipy, which live programs do not import. All matrices may be stacks of systems, shape (..., n, m).
"""

import numpy as np

from ..matrices import Matrix, contracts, product, quotient, transposed

_DOUBLINGS = 60
_SETTLED = 1e-13


class UnsolvableError(ValueError):
    """There is no stabilising solution; ``place`` is that of the first such system in the stack."""

    def __init__(self, place: int) -> None:
        super().__init__("the Riccati equation has no stabilising solution for these settings")
        self.place = place


def solve_riccati(a: Matrix, b: Matrix, q: Matrix, r: Matrix) -> Matrix:
    """Return the stabilising X, shape (..., n, n), of A (n, n), B (n, m), Q (n, n) and R (m, m).

    Raises UnsolvableError if the doubling does not settle because a mode that cannot be controlled
    grows.
    """
    identity = np.broadcast_to(np.eye(a.shape[-1]), a.shape)
    with np.errstate(all="ignore"):  # from systems that do not settle
        transition, acting = a, product(b, quotient(r, transposed(b)))
        g, h = acting, np.broadcast_to(q, a.shape)
        settled_h = np.full(a.shape, np.nan)
        for _ in range(_DOUBLINGS):
            inverse = quotient(identity + product(g, h), identity)
            whole = product(inverse, a)
            after = h + product(product(transposed(a), h), whole)
            g = g + product(product(product(a, inverse), g), transposed(a))
            a = product(a, whole)
            change = np.abs(after - h).max(axis=(-1, -2))
            h = 0.5 * (after + transposed(after))
            has_settled = change <= _SETTLED * np.abs(h).max(axis=(-1, -2))
            is_new = (
                has_settled & np.isnan(settled_h[..., 0, 0]) & np.isfinite(g).all(axis=(-1, -2))
            )
            settled_h = np.where(is_new[..., None, None], h, settled_h)
            if not np.isnan(settled_h).any():
                break
        closed = quotient(identity + product(acting, settled_h), transition)
        # A growing mode without cost is not stabilised.
        is_solved = contracts(closed, _DOUBLINGS)
    if not is_solved.all():
        raise UnsolvableError(int(np.argmin(is_solved)))
    return settled_h


def feedback_gain(a: Matrix, b: Matrix, q: Matrix, r: Matrix) -> Matrix:
    """Return K, shape (..., m, n), of u = -K x that minimises Σ (xᵀ Q x + uᵀ R u)."""
    forward = product(transposed(b), solve_riccati(a, b, q, r))
    return quotient(r + product(forward, b), product(forward, a))


def filter_gains(a: Matrix, h: Matrix, q: Matrix, r: Matrix, doublings: int = 0) -> list[Matrix]:
    """Return K, (..., n, m), of the correction x ← x + K (z - H x) after 1, 2, 4 ... periods.

    Before, there was a measurement in every period: the first K is the steady-state one.
    ``q`` and ``r`` are the covariances of the state's noise over a period and of the measurement.
    """
    p = solve_riccati(transposed(a), transposed(h), q, r)
    gains = [_gain(p, h, r)]
    for _ in range(doublings):  # A and Q of a period, then of 2, 4 ...
        p, q, a = _later(a, p, q), _later(a, q, q), product(a, a)
        gains.append(_gain(p, h, r))
    return gains


def _gain(p: Matrix, h: Matrix, r: Matrix) -> Matrix:
    observed = product(h, p)
    return transposed(quotient(r + product(observed, transposed(h)), observed))


def _later(a: Matrix, p: Matrix, q: Matrix) -> Matrix:
    return product(product(a, p), transposed(a)) + q
