"""Systems in Schur form: the response and the determinant of the matrices themselves."""

import numpy as np
import pytest

from steer_by_wire.controller.analysis.linear_system import LinearSystem, triangular

Z = np.exp(1j * np.linspace(0.01, np.pi, 50))


@pytest.mark.parametrize("seed", range(5))
def test_a_schur_form_has_the_response_and_the_determinant_of_its_system(seed: int) -> None:
    random = np.random.default_rng(seed)
    order, delays = 5, 30  # of which each delays another state by a tick
    a, b = 0.3 * random.normal(size=(order + delays,) * 2), random.normal(size=(order + delays, 2))
    a[order:], b[order:] = np.eye(order + delays)[order - 1 : -1], 0.0
    system = LinearSystem(a, b, random.normal(size=len(a)), random.normal(size=2))
    inverse = np.linalg.inv(Z[:, None, None] * np.eye(len(a)) - a)
    expected = (system.c @ inverse @ b).T + system.d[:, None]
    assert triangular(system).response(Z) == pytest.approx(expected, rel=1e-9)
    determinant = triangular(system).determinant(Z)
    assert determinant == pytest.approx(1.0 / np.linalg.det(inverse), rel=1e-9)
