"""Compiled runs on either side of a computed boundary; the searches have many more."""

import pytest

from steer_by_wire.closed_loop.scripting.feedback import computed_text
from tests.searches.feedback_boundaries import boundary_n_m, disagreements, drawn
from tests.searches.friction_holds import held_loops, real_swing_rad


@pytest.mark.parametrize(("number", "law"), [(3, "rack_force"), (13, "cdob"), (3, "dob")])
def test_runs_shake_where_the_analysis_says(number: int, law: str) -> None:
    boundary = boundary_n_m(loop := drawn(number)._replace(law=law))
    assert boundary is not None
    assert disagreements(loop, boundary) == []


@pytest.mark.parametrize(("number", "trip_ms"), [(17, 50), (51, 220)])
def test_friction_holds_swings_below_the_one_that_is_computed(number: int, trip_ms: int) -> None:
    _, held = next(held_loops(number))
    computed_rad, real_rad = held.computed.amplitude_rad, real_swing_rad(held)
    assert real_rad is not None
    assert 0.9 < real_rad / computed_rad < 1.05
    said = f"at {trip_ms} ms its friction holds swings of at most about ±{computed_rad:.2g} rad"
    assert said in computed_text(*held.settings())
