"""PATH_AHEAD of a compiled run against the plant's own, bit for bit."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from steer_by_wire.closed_loop.compiled.along_path import curvatures_ahead_1_m
from steer_by_wire.closed_loop.compiled.engine import compiled_motion
from steer_by_wire.plant_emulator.path.path_from_settings import build_path
from steer_by_wire.plant_emulator.sensors import path_ahead
from steer_by_wire.plant_emulator.settings import plant_preset


@pytest.mark.parametrize(
    "road",
    [
        '{kind="ellipse", semi_major_axis_m=60.0, semi_minor_axis_m=30.0}',
        '{kind="double_lane_change"}',
        '{kind="single_lane_change", start_m=33.3, offset_m=3.5, length_m=60.0}',
    ],
)
@given(st.lists(st.floats(0.0, 2000.0), min_size=1, max_size=20), st.floats(0.01, 10.0))
def test_the_curvatures_ahead_are_those_of_the_plant(
    road: str, places_m: list[float], spacing_m: float
) -> None:
    plant = plant_preset("highway_nominal", [f"path={road}"])
    path, (low, high) = build_path(plant.path), path_ahead.CURVATURES
    expected = [path_ahead.curvatures_ahead_1_m(path, at_m, spacing_m) for at_m in places_m]
    values = path_ahead.VALUES
    found = curvatures_ahead_1_m(
        compiled_motion(plant).path, np.array(places_m), spacing_m, values, low, high
    )
    np.testing.assert_array_equal(found, expected)
