"""A search that is stopped: the end of its time, and the costs with which it goes on."""

import math
from pathlib import Path

import pytest

from steer_by_wire.tools.design.search.stop_and_resume import (
    SearchStoppedError,
    kept_costs,
    stopped_after,
)
from tests.support.loops.shipped_design import shipped_spec, shipped_vehicle


def test_costs_are_kept_for_the_same_search_alone(tmp_path: Path) -> None:
    spec, vehicle, file = shipped_spec(), shipped_vehicle(), tmp_path / "costs"
    kept = kept_costs(file, spec, vehicle)
    assert kept.cost("one", lambda: 0.1) == 0.1
    assert kept.cost("dear", lambda: 9.0, ceiling=1.0) == 9.0
    again = kept_costs(file, spec, vehicle)
    assert again.cost("one", lambda: math.nan) == 0.1
    assert again.cost("dear", lambda: 8.0) == 8.0
    other = kept_costs(file, shipped_spec("peak_sensitivity_max=2"), vehicle)
    assert other.cost("one", lambda: 0.2) == 0.2


def test_a_search_ends_when_its_time_is_up() -> None:
    now_s = 0.0
    shown: list[float] = []
    progress = stopped_after(2.0, lambda done, _: shown.append(done), lambda: now_s)
    progress(0.1, 1.0)
    now_s = 120.5
    with pytest.raises(SearchStoppedError):
        progress(0.2, 1.0)
    assert shown == [0.1, 0.2]
