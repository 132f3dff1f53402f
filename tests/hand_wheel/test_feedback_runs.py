"""Runs of both nodes on either side of a computed boundary; the search has two hundred more."""

import pytest

from tests.searches.feedback_boundaries import (
    Loop,
    boundary_n_m,
    disagreements,
    drawn,
    is_unstable,
    kicked,
    settings_of,
)

NUMBERS = (3, 13)
"""One with the road's force, one with a CDOB."""


@pytest.mark.parametrize("number", NUMBERS)
def test_runs_shake_where_the_analysis_says(number: int) -> None:
    loop = drawn(number)
    boundary = boundary_n_m(loop)
    assert boundary is not None
    assert disagreements(loop, boundary) == []


def test_friction_hides_an_unstable_loop_until_a_kick() -> None:
    loop = Loop("rack_force", "hands_off", 80 / 3.6, 0.02, 0.15, 10.0, 2, 2)
    assert is_unstable(loop, 6.0)
    runs = (kicked(*settings_of(loop, 6.0, kick, friction_n_m=0.3)) for kick in (0.6, 3.0))
    small, large = (node.report() for node in runs)
    assert small["verdict"] == "still"
    assert large["verdict"].startswith("shakes at 1.")
