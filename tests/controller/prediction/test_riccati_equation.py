"""Gains of filter and feedback against scipy's Riccati solver, and cases without a solution."""

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from steer_by_wire.controller.matrices import Matrix
from steer_by_wire.controller.prediction.riccati_equation import feedback_gain, filter_gains

SYSTEMS = range(12)


def system(seed: int) -> tuple[Matrix, Matrix, Matrix, Matrix]:
    """Return A, unstable as often as not, with B, Q and R of some sizes."""
    random = np.random.default_rng(seed)
    n, m = int(random.integers(1, 8)), int(random.integers(1, 4))
    a = random.normal(size=(n, n)) / np.sqrt(n)
    b = random.normal(size=(n, m))
    q_root, r_root = random.normal(size=(n, n)), random.normal(size=(m, m))
    return a, b, q_root @ q_root.T, r_root @ r_root.T + 0.1 * np.eye(m)


@pytest.mark.parametrize("seed", SYSTEMS)
def test_the_feedback_gain_is_that_of_scipys_solution_and_stabilises(seed: int) -> None:
    a, b, q, r = system(seed)
    x = solve_discrete_are(a, b, q, r)
    k = feedback_gain(a, b, q, r)
    np.testing.assert_allclose(k, np.linalg.solve(r + b.T @ x @ b, b.T @ x @ a), rtol=1e-8)
    assert np.abs(np.linalg.eigvals(a - b @ k)).max() < 1.0


@pytest.mark.parametrize("seed", SYSTEMS)
def test_the_filter_gain_is_that_of_scipys_solution_and_the_error_decays(seed: int) -> None:
    a, c, q, r = system(seed)
    f, h = a.T, c.T
    p = solve_discrete_are(f.T, h.T, q, r)
    k = filter_gains(f, h, q, r)[0]
    np.testing.assert_allclose(k, p @ h.T @ np.linalg.inv(h @ p @ h.T + r), rtol=1e-8, atol=1e-10)
    assert np.abs(np.linalg.eigvals(f - k @ h @ f)).max() < 1.0


def test_a_slow_random_walk_settles() -> None:
    """Its filter forgets in an hour at 100 Hz: 360,000 steps, and a closed form."""
    q, r = 1e-10 * np.eye(1), np.eye(1)
    one = np.eye(1)
    p = 0.5 * (q + np.sqrt(q**2 + 4.0 * q * r))
    np.testing.assert_allclose(filter_gains(one, one, q, r)[0], p / (p + r), rtol=1e-9)


@pytest.mark.parametrize(
    ("a", "b", "q"),
    [
        (np.diag([1.2, 0.5]), np.array([[0.0], [1.0]]), np.eye(2)),  # grows and cannot be steered
        (np.diag([1.0, 0.5]), np.array([[0.0], [1.0]]), np.eye(2)),  # its cost grows, linearly
        (np.array([[1.2]]), np.eye(1), np.zeros((1, 1))),  # grows and costs nothing
    ],
)
def test_what_has_no_stabilising_solution_is_refused(a: Matrix, b: Matrix, q: Matrix) -> None:
    with pytest.raises(ValueError, match="no stabilising solution"):
        feedback_gain(a, b, q, np.eye(1))
