"""Laws as matrices: states that only delay others are eliminated, exactly."""

import numpy as np
import pytest

from steer_by_wire.controller.analysis.linear_system import LinearSystem

Z = np.exp(1j * np.linspace(0.01, np.pi, 50))


def drawn(seed: int) -> LinearSystem:
    """Return a system in which some states delay others: in chains, from two roots, in a circle."""
    random = np.random.default_rng(seed)
    own, order = 3, int(random.integers(4, 12))
    a, b = 0.3 * random.normal(size=(order, order)), random.normal(size=order)
    for late in range(own, order):
        a[late], b[late] = np.eye(order)[random.integers(0, late)], 0.0
    if seed % 3 == 0:  # the last two delay each other
        a[[-1, -2]] = np.eye(order)[[-2, -1]]
        b[-2] = 0.0
    mixed = random.permutation(order)
    c = random.normal(size=order)
    return LinearSystem(a[np.ix_(mixed, mixed)], b[mixed], c[mixed], 0.7)


@pytest.mark.parametrize("seed", range(30))
def test_delays_are_eliminated_exactly(seed: int) -> None:
    system = drawn(seed)
    inverse = np.linalg.inv(Z[:, None, None] * np.eye(len(system.b)) - system.a)
    determinant, response = system.determinant_and_response(Z)
    assert determinant == pytest.approx(1.0 / np.linalg.det(inverse), rel=1e-9)
    assert response == pytest.approx(system.c @ inverse @ system.b + system.d, rel=1e-9)
