"""Paths by their shape: straight, circle, ellipse, lane changes, a curvature over arc length.

ellipse: SAE 2018-01-1086, Fig. 14, to the left, from the end of the major axis, where it bends
most. Its curvature is interpolated (`plant_emulator.path.curve_to_path`).

lane changes: clothoids with the curvatures 0, κ, 0, −κ, 0 at equal distances, so that the heading
returns to its old value. The double one has the proportions of ISO 3888-1: 30 m to the other lane,
25 m along it, 25 m back.
"""

import math
from collections.abc import Sequence
from functools import lru_cache
from itertools import pairwise

import numpy as np

from ...runtime.array_types import FloatArray
from .curve_to_path import CurvePoints, path_along
from .path import Path, Pose, along_clothoid
from .portable_trigonometry import cos_and_sin

ISO_3888_1_SIDE_LANE = 25.0 / 30.0
"""Lengths of the side lane and of the way back, relative to the way out (double lane change)."""

_KEPT = 8
"""Ellipses cached for the next run: each takes about 30 ms to compute."""
_EAST = Pose(0.0, 0.0, 0.0)

BreakPoint = tuple[float, float]
"""Arc length [m] and curvature there [1/m]."""


def straight() -> Path:
    """Return the x axis."""
    return path_of_curvature([])


def circle(radius_m: float) -> Path:
    """Return a circle to the left that starts at its rightmost point, northbound."""
    start = Pose(radius_m, 0.0, 0.5 * math.pi)
    return Path(
        [0.0], [1.0 / radius_m], [0.0], [start], 2.0 * math.pi * radius_m, 2.0 * math.pi, True
    )


@lru_cache(maxsize=_KEPT)
def ellipse(semi_major_axis_m: float, semi_minor_axis_m: float) -> Path:
    """Return an ellipse about the origin that starts at (semi-major axis, 0), to the left."""
    a, b = semi_major_axis_m, semi_minor_axis_m

    def curve(t: FloatArray) -> CurvePoints:
        cos, sin = cos_and_sin(t)
        x, y = a * cos, b * sin
        return CurvePoints(x, y, -a * sin, b * cos, -x, -y)

    return path_along(curve, np.linspace(0.0, 2.0 * math.pi, 65), closed=True, has_kinks=False)


def single_lane_change(start_m: float, offset_m: float, length_m: float) -> Path:
    """Return a straight of ``start_m``, then a change by ``offset_m`` within ``length_m`` of it.

    Both are measured across and along the road; |offset| may be half the length.
    """
    return path_of_curvature(lane_change(start_m, offset_m, length_m))


def double_lane_change(start_m: float, offset_m: float, length_m: float) -> Path:
    """Return a straight, the way out (as `single_lane_change`), the side lane, the way back."""
    way_out = lane_change(start_m, offset_m, length_m)
    side_lane_m = ISO_3888_1_SIDE_LANE * length_m
    back_m = way_out[-1][0] + side_lane_m
    return path_of_curvature(way_out + lane_change(back_m, -offset_m, side_lane_m))


def lane_change(start_m: float, offset_m: float, length_m: float) -> list[BreakPoint]:
    """Return the break points of a lane change that starts at arc length ``start_m``."""
    low, high = 0.0, 6.0
    # The shape of arc length 1 with peak curvature k; offset/length grows with k.
    for _ in range(60):
        k = 0.5 * (low + high)
        end = _end_of(_shape(0.0, k, 1.0))
        low, high = (k, high) if end.y_m * length_m < abs(offset_m) * end.x_m else (low, k)
    arc_m = length_m / _end_of(_shape(0.0, low, 1.0)).x_m
    return _shape(start_m, math.copysign(low, offset_m) / arc_m, arc_m)


def _shape(start_m: float, peak_1_m: float, arc_m: float) -> list[BreakPoint]:
    quarter = 0.25 * arc_m
    return [
        (start_m, 0.0),
        (start_m + quarter, peak_1_m),
        (start_m + 3.0 * quarter, -peak_1_m),
        (start_m + arc_m, 0.0),
    ]


def _end_of(points: list[BreakPoint]) -> Pose:
    return path_of_curvature(points).pose[-1]


def path_of_curvature(points: Sequence[BreakPoint]) -> Path:
    """Return the path that starts eastward and has these curvatures, straight before and after.

    ``points``  (arc length [m] from 0 on, curvature there [1/m]) with arc lengths that rise, the
                last with curvature 0; between two points the curvature is linear (a clothoid)

    Raises ValueError.

    >>> road = path_of_curvature([(10.0, 0.0), (15.0, 0.02), (20.0, 0.0)])
    >>> road.length_m, round(road.pose[-1].heading_rad, 9)
    (20.0, 0.1)
    """
    points = [*points]
    if any(later[0] <= earlier[0] for earlier, later in pairwise(points)):
        raise ValueError("arc lengths must rise")
    if points and (points[0][0] < 0.0 or points[-1][1] != 0.0):
        raise ValueError("the first arc length must not be negative, the last curvature must be 0")
    if not points or points[0][0] > 0.0:
        points = [(0.0, 0.0), *points]
    slopes = [
        (to_curvature - from_curvature) / (to_m - from_m)
        for (from_m, from_curvature), (to_m, to_curvature) in pairwise(points)
    ]
    poses = [_EAST]
    for (from_m, curvature), (to_m, _), slope in zip(points, points[1:], slopes, strict=False):
        poses.append(along_clothoid(poses[-1], curvature, slope, to_m - from_m))
    start_m, curvatures = zip(*points, strict=True)
    return Path(
        list(start_m), list(curvatures), [*slopes, 0.0], poses, start_m[-1], 0.0, closed=False
    )
