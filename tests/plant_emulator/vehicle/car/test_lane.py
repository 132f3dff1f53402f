"""A car's body against its lane, by the nodes, in a study and by hand."""

import math

import numpy as np
import pytest

from steer_by_wire.closed_loop.compiled.engine import run_compiled
from steer_by_wire.closed_loop.pair.virtual_pair import make_virtual_pair
from steer_by_wire.closed_loop.studies.compiled_runs import verdict_on
from steer_by_wire.controller.settings import controller_preset
from steer_by_wire.plant_emulator.evaluation.report_in_words import verdict_text
from steer_by_wire.plant_emulator.path.cg_deviation import cg_deviation_m
from steer_by_wire.plant_emulator.path.corridor import Lane, beyond_lane_m
from steer_by_wire.plant_emulator.path.path import vehicle_pose
from steer_by_wire.plant_emulator.path.path_from_settings import build_path
from steer_by_wire.plant_emulator.path.settings import CircleSettings
from steer_by_wire.plant_emulator.settings import plant_preset

LANE = Lane(half_m=1.75, front_m=2.4, rear_m=2.6, side_m=0.9)


def test_a_corner_is_where_geometry_puts_it_on_a_bend() -> None:
    """The centre of the circle is the origin."""
    path = build_path(CircleSettings(kind="circle", radius_m=30.0))
    for error_m, heading_rad in ((0.0, 0.0), (0.8, 0.2), (-0.6, -0.3)):
        at = vehicle_pose(path, 20.0, heading_rad, error_m, 2.0)
        cos, sin = math.cos(at.heading_rad), math.sin(at.heading_rad)
        off_m = [
            abs(30.0 - math.hypot(
                at.x_m + along * cos - across * sin,
                at.y_m + along * sin + across * cos,
            ))
            for along in (LANE.front_m, -LANE.rear_m)
            for across in (LANE.side_m, -LANE.side_m)
        ]  # fmt: skip
        rear_m = cg_deviation_m(path, 20.0, heading_rad, error_m, 2.0 + LANE.rear_m)
        found_m = beyond_lane_m(LANE, 2.0, heading_rad, error_m, 1.0 / 30.0, rear_m)
        assert found_m == pytest.approx(max(off_m) - LANE.half_m, abs=0.01)


@pytest.mark.parametrize("lane_m", [1.7, 3.5])
def test_a_car_is_judged_by_its_body_in_the_lane(lane_m: float) -> None:
    """A lane that is 0.1 m wider than the car is left; one of 3.5 m is not."""
    plant = plant_preset("bmw_320i", [f"car.lane_m={lane_m}", "duration_s=20"])
    controller = controller_preset("highway_pd")
    pair = make_virtual_pair(plant, controller)
    pair.run()
    report = pair.plant.report()
    worst_m = max(abs(sample.cg_deviation_m) for sample in pair.plant.samples)
    assert report["beyond_lane_m"] == pytest.approx(worst_m + 0.5 * 1.61 - 0.5 * lane_m, abs=0.03)
    assert (report["verdict"] == "left road") == (lane_m < 2.0)
    assert ("left the lane by" in verdict_text(report)) == (lane_m < 2.0)
    assert verdict_on(plant, controller, run_compiled(plant, controller)) == report["verdict"]
    assert np.isfinite(report["rms_m"])
