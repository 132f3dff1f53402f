"""The lattice of the design's parameters, and the evolution strategy that searches on it."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from steer_by_wire.tools.design.search.evolution import evolve
from steer_by_wire.tools.design.search.law_parameters import lattice_place, lattice_value


def test_the_lattice_rises_in_steps_of_at_most_two_and_a_half_percent() -> None:
    values = [lattice_value(place) for place in range(-400, 400)]
    ratios = np.array(values[1:]) / np.array(values[:-1])
    assert 1.009 < ratios.min() < ratios.max() < 1.0251
    assert lattice_value(0) == 1.0
    assert all(float(f"{value:.3g}") == value for value in values)


@pytest.mark.parametrize("place", [-321, -160, -1, 0, 1, 49, 50, 159, 160, 777])
def test_a_value_of_the_lattice_has_its_place_and_so_has_what_is_between(place: int) -> None:
    assert lattice_place(lattice_value(place)) == place
    assert lattice_place(1.004 * lattice_value(place)) == place
    assert lattice_place(0.999 * lattice_value(place)) == place - 1


def ridge(x: NDArray[np.float64]) -> float:
    """Rosenbrock's function; its minimum is at 1, at the end of a bent ridge."""
    return float(np.sum(100.0 * (x[1:] - x[:-1] ** 2) ** 2 + (1.0 - x[:-1]) ** 2))


def cornered(x: NDArray[np.float64]) -> float:
    """Falls with both coordinates down to where their product has to be 1: at (0.5, 2)."""
    short = 1.0 - x[0] * x[1] if min(x) > 0.0 else 10.0
    return 1e6 * (1.0 + short) if short > 0.0 else float(4.0 * x[0] + x[1])


@pytest.mark.parametrize(
    ("cost", "start", "minimum"),
    [(ridge, [-1.0, 2.0, 0.0], [1.0, 1.0, 1.0]), (cornered, [3.0, 3.0], [0.5, 2.0])],
)
def test_the_evolution_follows_a_ridge_and_a_demand_to_the_minimum(
    cost: Callable[[NDArray[np.float64]], float], start: list[float], minimum: list[float]
) -> None:
    random = np.random.default_rng(3)
    for generation in evolve(
        lambda x, _: cost(x), np.array(start), np.ones(len(start)), 14, random
    ):
        if generation.number == 250:
            assert generation.best == pytest.approx(minimum, abs=2e-3)
            assert generation.judged == 250 * 14
            break
