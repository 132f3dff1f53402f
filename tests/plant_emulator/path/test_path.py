import math
from pathlib import Path as FilePath

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.special import ellipe, fresnel

from steer_by_wire.plant_emulator.path.curve_to_path import CURVATURE_TOLERANCE
from steer_by_wire.plant_emulator.path.ellipse_and_lane_changes import (
    circle,
    double_lane_change,
    ellipse,
    single_lane_change,
    straight,
)
from steer_by_wire.plant_emulator.path.path import (
    Path,
    Place,
    Pose,
    along_clothoid,
    curvature,
    end_of_place_m,
    next_place,
    pose,
    vehicle_pose,
)
from steer_by_wire.plant_emulator.path.path_from_settings import build_path
from steer_by_wire.plant_emulator.path.settings import (
    CircleSettings,
    DoubleLaneChangeSettings,
    EllipseSettings,
    SingleLaneChangeSettings,
    StraightSettings,
    WaypointSettings,
)
from steer_by_wire.plant_emulator.path.waypoints import path_through
from steer_by_wire.runtime.settings import SettingsError

AXES = [(78.2, 41.74), (60.0, 30.0), (50.0, 50.0), (30.0, 3.0)]


def integrated(path: Path, to_m: float) -> Pose:
    """Return the pose that the curvature alone leads to, by the trapezoidal rule."""
    s = np.linspace(0.0, to_m, 200_001)
    heading = path.pose[0].heading_rad + _cumulative(np.array([curvature(path, x) for x in s]), s)
    x = path.pose[0].x_m + _cumulative(np.cos(heading), s)[-1]
    y = path.pose[0].y_m + _cumulative(np.sin(heading), s)[-1]
    return Pose(float(x), float(y), float(heading[-1]))


def _cumulative(values: np.ndarray, s: np.ndarray) -> np.ndarray:
    return np.concatenate(([0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(s))))


@pytest.mark.parametrize(("a", "b"), AXES)
def test_ellipse_has_its_true_arc_length(a: float, b: float) -> None:
    assert ellipse(a, b).length_m == pytest.approx(4.0 * a * ellipe(1.0 - (b / a) ** 2), rel=1e-12)


@pytest.mark.parametrize(("a", "b"), AXES)
def test_ellipse_bends_as_the_formula_says_within_the_stated_tolerance(a: float, b: float) -> None:
    path = ellipse(a, b)
    t = np.linspace(0.0, 2.0 * np.pi, 200_001)
    s = _cumulative(np.ones_like(t), np.zeros_like(t)) + _cumulative(
        np.hypot(a * np.sin(t), b * np.cos(t)), t
    )
    exact = a * b / (a**2 * np.sin(t) ** 2 + b**2 * np.cos(t) ** 2) ** 1.5
    error = [abs(curvature(path, s[i]) - exact[i]) for i in range(0, 200_000, 7)]
    assert max(error) <= CURVATURE_TOLERANCE * a / b**2
    assert curvature(path, 0.0) == pytest.approx(a / b**2, rel=1e-12)


@pytest.mark.parametrize(("a", "b"), AXES)
def test_driving_by_the_curvature_of_an_ellipse_closes_the_lap(a: float, b: float) -> None:
    path = ellipse(a, b)
    x, y, heading = integrated(path, path.length_m)
    assert (x, y) == pytest.approx((a, 0.0), abs=1e-5 * a)
    assert heading == pytest.approx(2.5 * math.pi, abs=1e-6)


@given(
    st.floats(-3.5, 3.5).filter(lambda offset: abs(offset) > 0.01),
    st.floats(10.0, 100.0),
    st.floats(0.0, 50.0),
)
def test_lane_change_ends_at_its_offset_and_length_with_the_heading_it_began_with(
    offset_m: float, length_m: float, start_m: float
) -> None:
    path = single_lane_change(start_m, offset_m, length_m)
    x, y, heading = pose(path, path.length_m)
    assert (x, y) == pytest.approx((start_m + length_m, offset_m), abs=1e-9)
    assert heading == pytest.approx(0.0, abs=1e-12)
    assert curvature(path, path.length_m + 1.0) == 0.0


def test_double_lane_change_returns_in_the_proportions_of_iso_3888_1() -> None:
    path = double_lane_change(15.0, 3.5, 30.0)
    assert pose(path, path.length_m) == pytest.approx((15.0 + 80.0, 0.0, 0.0), abs=1e-9)
    in_side_lane = [p for p in path.pose if abs(p.y_m - 3.5) < 1e-9]
    assert [p.x_m for p in in_side_lane] == pytest.approx([45.0, 70.0])


@given(st.floats(0.001, 0.2), st.floats(0.1, 40.0))
def test_clothoid_is_the_fresnel_integral(slope: float, length_m: float) -> None:
    x, y, heading = along_clothoid(Pose(0.0, 0.0, 0.0), 0.0, slope, length_m)
    scale = math.sqrt(math.pi / slope)
    sine, cosine = fresnel(length_m / scale)
    assert (x, y) == pytest.approx((scale * cosine, scale * sine), abs=2e-11 * length_m + 1e-15)
    assert heading == pytest.approx(0.5 * slope * length_m**2)


@given(st.sampled_from([(3.0, 0), (0.0, 0), (290.0, 1), (900.0, 3)]))
def test_places_cover_the_arc_length_without_gaps(target: tuple[float, int]) -> None:
    to_m, _ = target
    path = ellipse(60.0, 30.0)
    place, reached_m = Place(0, 0), 0.0
    while reached_m <= to_m:
        end_m = end_of_place_m(path, place)
        assert end_m > reached_m
        place, reached_m = next_place(path, place), end_m
    assert place.lap == int(reached_m / path.length_m + 1e-9)


def test_vehicle_stands_preview_distance_behind_and_beside_its_preview_point() -> None:
    path = straight()
    heading = math.atan2(3.0, 4.0)
    x, y, _ = vehicle_pose(path, 10.0, heading, 0.5, 5.0)
    assert (x, y) == pytest.approx((10.0 - 4.0, 0.5 - 3.0))


def write(file: FilePath, points: np.ndarray) -> FilePath:
    rows = "\n".join(f"{x!r},{y!r}" for x, y in points.tolist())
    file.write_text(f"# a comment\nx_m,y_m\n{rows}\n", encoding="utf-8")
    return file


def test_waypoints_on_an_ellipse_make_that_ellipse(tmp_path: FilePath) -> None:
    t = np.linspace(0.0, 2.0 * np.pi, 200, endpoint=False)
    file = write(tmp_path / "ellipse.csv", np.stack([60 * np.cos(t), 30 * np.sin(t)], axis=1))
    path = build_path(WaypointSettings(file=file, closed=True))
    exact = ellipse(60.0, 30.0)
    assert path.length_m == pytest.approx(exact.length_m, rel=1e-5)
    assert path.lap_turn_rad == pytest.approx(2.0 * math.pi, abs=1e-6)
    for fraction in np.linspace(0.0, 1.0, 200):
        s = fraction * exact.length_m
        assert curvature(path, s) == pytest.approx(curvature(exact, s), abs=2e-4)


def test_open_path_meets_its_waypoints_and_goes_on_straight(tmp_path: FilePath) -> None:
    points = np.array([[0.0, 0.0], [10.0, 1.0], [20.0, 4.0], [30.0, 4.0], [40.0, 0.0]])
    path = build_path(WaypointSettings(file=write(tmp_path / "open.csv", points)))
    places = [pose(path, s) for s in np.linspace(0.0, path.length_m, 5000)]
    for x, y in points:
        assert min(math.hypot(p.x_m - x, p.y_m - y) for p in places) < 0.01
    assert pose(path, path.length_m)[:2] == pytest.approx((40.0, 0.0))
    assert curvature(path, path.length_m + 5.0) == 0.0
    assert pose(path, path.length_m)[:2] == pytest.approx(
        integrated(path, path.length_m)[:2], abs=1e-3
    )


@given(st.lists(st.floats(-2.0, 2.0), min_size=4, max_size=30))
@example([20.0 * math.sin(x / 4.0) + 3.0 * math.sin(x / 1.3) for x in range(61)])
@example([2.0, -2.0] * 15)
def test_a_road_that_was_surveyed_has_few_pieces_that_join(y_m: list[float]) -> None:
    """A cubic spline's curvature has a kink at each of its points, where halving would not end.

    The sharpest road that is drawn, from side to side at each point, takes 256 pieces a span.
    """
    path = path_through([(10.0 * number, y) for number, y in enumerate(y_m)])
    assert len(path.start_m) <= 256 * (len(y_m) - 1) + 1
    pieces = zip(path.pose, path.curvature_1_m, path.curvature_slope_1_m2, strict=True)
    lengths_m = np.diff(path.start_m).tolist()
    ends = [along_clothoid(*piece, m) for piece, m in zip(pieces, lengths_m, strict=False)]
    assert np.abs(np.array(ends) - np.array(path.pose[1:])).max() < 1e-4


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", ": the first line must name the columns x_m,y_m"),
        ("x_m,y_m\n1,2\n1,2\n", ": must hold 2 to 100000 points that lie apart, not 1"),
        ("x_m,y_m\n1,2\n2\n3,4\n", ", line 3: must be x_m,y_m within ±1e+08, not '2,'"),
        ("x_m,y_m\n1,2\n\nnan,2\n3,4\n", ", line 4: must be x_m,y_m within ±1e+08, not 'nan,2'"),
        ("x_m,y_m\n0,0\n1,0\n0,0\n1,0\n", ", line 2: the path bends too sharply"),
        ("x_m,y_m\n0,0\n20,0\n40,0\n20,0\n0,0\n", ", line 3: the path bends too sharply"),
        ("x_m,y_m\n0,0\n1e308,0\n", ", line 3: must be x_m,y_m within ±1e+08, not '1e308,0'"),
    ],
)
def test_bad_waypoint_file_gives_one_clear_line(
    tmp_path: FilePath, text: str, message: str
) -> None:
    file = tmp_path / "bad.csv"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(SettingsError) as caught:
        build_path(WaypointSettings(file=file))
    assert str(caught.value).startswith(f"{file}{message}")
    assert "\n" not in str(caught.value)


def test_two_swapped_points_are_found_by_their_line(tmp_path: FilePath) -> None:
    points = [(80.0 * math.cos(0.05 * i), 40.0 * math.sin(0.05 * i)) for i in range(60)]
    points[30], points[31] = points[31], points[30]
    file = write(tmp_path / "swapped.csv", np.array(points))
    with pytest.raises(SettingsError, match=r"line (3[1-4]): the path bends too sharply"):
        build_path(WaypointSettings(file=file))


def test_a_path_in_map_coordinates_is_the_path_near_zero(tmp_path: FilePath) -> None:
    points = np.array([[50.0 * i, 8.0 * math.sin(i)] for i in range(20)])
    paths = [
        build_path(
            WaypointSettings(file=write(tmp_path / f"{north}.csv", points + np.array([0.0, north])))
        )
        for north in (0.0, 4_182_000.0)
    ]
    assert np.allclose(paths[0].curvature_1_m, paths[1].curvature_1_m, rtol=0.0, atol=1e-8)
    assert paths[1].pose[5].y_m - paths[0].pose[5].y_m == pytest.approx(4_182_000.0, abs=1e-6)


def test_two_points_and_points_of_a_receiver_at_rest_make_a_path() -> None:
    straight_on = path_through([(0.0, 0.0), (30.0, 40.0)])
    assert straight_on.length_m == pytest.approx(50.0)
    assert max(map(abs, straight_on.curvature_1_m)) < 1e-12
    resting = [(10.0 * i, i % 2) for i in range(6) for _ in range(1 + 20 * (i == 3))]
    assert path_through(resting) == path_through([(10.0 * i, i % 2) for i in range(6)])


def test_a_receiver_that_wanders_at_rest_gives_the_path_without_its_halt() -> None:
    rng = np.random.default_rng(58)
    driven = [(2.0 * i, 20.0 * math.sin(i / 30.0)) for i in range(120)]
    halt = driven[60] + rng.uniform(-0.5, 0.5, (40, 2))
    points = [*driven[:61], *(tuple(point) for point in halt), *driven[61:]]
    with pytest.raises(ValueError, match="bends too sharply"):
        path_through(points)
    path, without = (path_through(each, spacing_min_m=3.0) for each in (points, driven))
    apart_m = [math.dist(pose(path, s_m)[:2], pose(without, s_m)[:2]) for s_m in range(0, 240, 5)]
    assert max(apart_m) < 0.2


def test_a_hundred_thousand_points_make_a_path() -> None:
    path = path_through([(0.5 * i, 3.0 * math.sin(0.01 * i)) for i in range(100_000)])
    assert path.length_m == pytest.approx(0.5 * 99_999, rel=1e-2)


def test_missing_or_binary_waypoint_file_gives_one_clear_line(tmp_path: FilePath) -> None:
    with pytest.raises(SettingsError, match=r"nowhere.csv: cannot be read: No such file"):
        build_path(WaypointSettings(file=tmp_path / "nowhere.csv"))
    (tmp_path / "binary.csv").write_bytes(b"x_m,y_m\n\xff\xfe")
    with pytest.raises(SettingsError, match=r"binary.csv: is not UTF-8 text"):
        build_path(WaypointSettings(file=tmp_path / "binary.csv"))


def test_every_kind_of_settings_builds_its_path() -> None:
    assert build_path(StraightSettings()) == straight()
    assert build_path(CircleSettings(radius_m=20.0)) == circle(20.0)
    assert build_path(EllipseSettings()) == ellipse(78.2, 41.74)
    assert build_path(SingleLaneChangeSettings()) == single_lane_change(10.0, 3.5, 30.0)
    assert build_path(DoubleLaneChangeSettings()) == double_lane_change(10.0, 3.5, 30.0)


def test_settings_that_make_no_road_are_refused() -> None:
    with pytest.raises(SettingsError, match="1 to 10 times semi_minor_axis_m"):
        EllipseSettings(semi_major_axis_m=30.0, semi_minor_axis_m=60.0)
    with pytest.raises(SettingsError, match="offset_m must not exceed half of length_m"):
        SingleLaneChangeSettings(offset_m=-6.0, length_m=10.0)
