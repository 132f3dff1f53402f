"""Deviation of the centre of gravity: against the nearest point of the path, found by search."""

import math

import pytest
from scipy.optimize import minimize_scalar

from steer_by_wire.plant_emulator.path.cg_deviation import cg_deviation_m
from steer_by_wire.plant_emulator.path.ellipse_and_lane_changes import (
    circle,
    double_lane_change,
    ellipse,
    straight,
)
from steer_by_wire.plant_emulator.path.path import Path, pose, vehicle_pose

PREVIEW_M = 2.0


def nearest_m(path: Path, arc_length_m: float, heading_rad: float, error_m: float) -> float:
    """Return the signed distance of the CG from the path's nearest point [m]."""
    cg = vehicle_pose(path, arc_length_m, heading_rad, error_m, PREVIEW_M)

    def distance_m(at_m: float) -> float:
        point = pose(path, at_m)
        return math.hypot(cg.x_m - point.x_m, cg.y_m - point.y_m)

    bounds = (arc_length_m - 2.0 * PREVIEW_M, arc_length_m)
    found = minimize_scalar(distance_m, bounds=bounds, options={"xatol": 1e-9})
    beside = pose(path, float(found.x))
    return (cg.y_m - beside.y_m) * math.cos(beside.heading_rad) - (cg.x_m - beside.x_m) * math.sin(
        beside.heading_rad
    )


@pytest.mark.parametrize(
    "path",
    [straight(), circle(30.0), ellipse(60.0, 30.0), double_lane_change(10.0, 3.5, 30.0)],
    ids=["straight", "circle", "ellipse", "lane change"],
)
@pytest.mark.parametrize(("heading_rad", "error_m"), [(0.0, 0.0), (-0.2, 0.3), (0.1, -0.5)])
def test_it_is_the_distance_to_the_nearest_point(
    path: Path, heading_rad: float, error_m: float
) -> None:
    for arc_length_m in (4.0, 13.0, 25.0, 44.0, 100.0, 230.0):
        found_m = cg_deviation_m(path, arc_length_m, heading_rad, error_m, PREVIEW_M)
        expected_m = nearest_m(path, arc_length_m, heading_rad, error_m)
        assert found_m == pytest.approx(expected_m, abs=2e-5)


def test_a_preview_point_on_a_circle_leaves_the_vehicle_beside_it() -> None:
    """Pythagoras: the CG of a vehicle along the tangent of a circle of 30 m is outside it."""
    outside_m = math.hypot(30.0, PREVIEW_M) - 30.0
    assert cg_deviation_m(circle(30.0), 7.0, 0.0, 0.0, PREVIEW_M) == pytest.approx(-outside_m)
    # In the steady turn it points out of the circle, and is inside.
    out_rad = -(1.5453 + PREVIEW_M) / 30.0
    assert cg_deviation_m(circle(30.0), 7.0, out_rad, 0.0, PREVIEW_M) > 0.1


def test_an_open_path_is_straight_before_its_start() -> None:
    road = double_lane_change(0.0, 3.5, 30.0)
    assert cg_deviation_m(road, 0.0, 0.0, 0.0, PREVIEW_M) == pytest.approx(0.0, abs=1e-12)
    assert cg_deviation_m(road, 0.0, 0.1, 0.0, PREVIEW_M) == pytest.approx(
        -PREVIEW_M * math.sin(0.1)
    )
