"""Runs of both nodes on either side of a computed boundary; the search has two hundred more."""

import pytest

from tests.searches.feedback_boundaries import boundary_n_m, disagreements, drawn

NUMBERS = (3, 13)
"""One with the road's force, one with a CDOB."""


@pytest.mark.parametrize("number", NUMBERS)
def test_runs_shake_where_the_analysis_says(number: int) -> None:
    loop = drawn(number)
    boundary = boundary_n_m(loop)
    assert boundary is not None
    assert disagreements(loop, boundary) == []
