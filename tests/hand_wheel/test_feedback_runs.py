"""Runs of both nodes on either side of a computed boundary; the search has two hundred more."""

import numpy as np
import pytest

from steer_by_wire.closed_loop.scripting.feedback import computed_text, friction_threshold
from tests.searches.feedback_boundaries import (
    Loop,
    boundary_n_m,
    disagreements,
    drawn,
    kicked,
    settings_of,
)


@pytest.mark.parametrize(("number", "law"), [(3, "rack_force"), (13, "cdob"), (3, "dob")])
def test_runs_shake_where_the_analysis_says(number: int, law: str) -> None:
    boundary = boundary_n_m(loop := drawn(number)._replace(law=law))
    assert boundary is not None
    assert disagreements(loop, boundary) == []


def test_friction_holds_swings_below_the_one_that_is_computed() -> None:
    loop = Loop("rack_force", "hands_off", 80 / 3.6, 0.02, 0.15, 10.0, 2, 2)
    pair = settings_of(loop, 6.0, friction_n_m=0.3)
    found = friction_threshold(*pair, 0.04)
    assert found is not None
    assert f"at 40 ms its friction holds swings up to about ±{found[0]:.2g}" in computed_text(*pair)
    for kick_n_m, verdict in ((1.77, "still"), (1.83, "shakes at 1.")):
        node = kicked(*settings_of(loop, 6.0, kick_n_m, friction_n_m=0.3))
        early_rad = [sample.angle_rad for sample in node.samples[100:180]]
        assert 0.5 * np.ptp(early_rad) == pytest.approx(found.amplitude_rad, rel=0.12)
        assert node.report()["verdict"].startswith(verdict)
