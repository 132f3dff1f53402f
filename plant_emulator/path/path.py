"""A path as curvature over arc length: pieces of linear curvature (clothoids) between break points.

    ρ(s) = ρ_k + ρ'_k (s − s_k)   for s_k <= s < s_{k+1}

    s   arc length from the start [m]
    ρ   curvature, 1/radius, to the left positive [1/m]

Only the curvature acts on the vehicle: at constant speed, ρ is a ramp over time between break
points, so the motion stays exact. The pose of every break point is stored too, for pictures. It
comes from the curve itself, so that no error accumulates.
"""

from bisect import bisect_right
from collections.abc import Sequence
from math import ceil, cos, sin
from typing import NamedTuple

GAUSS = (
    (0.04691007703066800, 0.11846344252809454),
    (0.23076534494715845, 0.23931433524968324),
    (0.5, 0.28444444444444444),
    (0.76923465505284155, 0.23931433524968324),
    (0.95308992296933200, 0.11846344252809454),
)
"""Nodes and weights of Gauss-Legendre quadrature on [0, 1], exact up to degree 9."""

_TURN_MAX_RAD = 0.5
"""Largest turn per quadrature; the error is 1e-11 of its length."""


class Pose(NamedTuple):
    """A point of the path and the direction there."""

    x_m: float
    y_m: float
    heading_rad: float
    """Counter-clockwise from the x axis, over all laps."""


class Path(NamedTuple):
    """Break points in order of arc length, the first at 0.

    A closed path starts again at ``length_m``; an open one goes on with its last piece.
    """

    start_m: Sequence[float]
    curvature_1_m: Sequence[float]
    """At the start of each piece."""
    curvature_slope_1_m2: Sequence[float]
    pose: Sequence[Pose]
    """At the start of each piece."""
    length_m: float
    """Arc length of one lap, or up to the last break point."""
    lap_turn_rad: float
    """Change of heading over one lap; 0 for an open path."""
    closed: bool


class Place(NamedTuple):
    """A piece of the path in a lap."""

    lap: int
    piece: int


def next_place(path: Path, place: Place) -> Place:
    """Return the next piece; an open path must have one."""
    if place.piece + 1 < len(path.start_m):
        return Place(place.lap, place.piece + 1)
    return Place(place.lap + 1, 0)


def end_of_place_m(path: Path, place: Place) -> float:
    """Return the arc length over all laps where the piece ends; infinite after an open path."""
    if place.piece + 1 < len(path.start_m):
        return place.lap * path.length_m + path.start_m[place.piece + 1]
    if path.closed:
        return (place.lap + 1) * path.length_m
    return float("inf")


def locate(path: Path, arc_length_m: float) -> tuple[int, int, float]:
    """Return lap and piece that hold a point, and its distance from the piece's start [m]."""
    start_m = path.start_m
    lap, in_lap_m = 0, arc_length_m
    if path.closed:
        length_m = path.length_m
        lap = int(arc_length_m // length_m)
        in_lap_m -= lap * length_m
    piece = bisect_right(start_m, in_lap_m) - 1 if in_lap_m > 0.0 else 0
    return lap, piece, in_lap_m - start_m[piece]


def curvature(path: Path, arc_length_m: float) -> float:
    """Return the curvature [1/m] at an arc length >= 0; at a jump, the value after it."""
    _, piece, along_m = locate(path, arc_length_m)
    return path.curvature_1_m[piece] + path.curvature_slope_1_m2[piece] * along_m


def pose(path: Path, arc_length_m: float) -> Pose:
    """Return the pose of the path at an arc length >= 0."""
    lap, piece, along_m = locate(path, arc_length_m)
    start = path.pose[piece]
    turned = start._replace(heading_rad=start.heading_rad + lap * path.lap_turn_rad)
    return along_clothoid(
        turned, path.curvature_1_m[piece], path.curvature_slope_1_m2[piece], along_m
    )


def along_clothoid(start: Pose, curvature_1_m: float, slope_1_m2: float, length_m: float) -> Pose:
    """Return the pose ``length_m`` along a piece of linear curvature; negative: back along it."""
    turn_bound = abs(length_m) * max(abs(curvature_1_m), abs(curvature_1_m + slope_1_m2 * length_m))
    parts = max(1, ceil(turn_bound / _TURN_MAX_RAD))
    part_m = length_m / parts
    x, y = start.x_m, start.y_m
    for part in range(parts):
        for node, weight in GAUSS:
            s = (part + node) * part_m
            heading = start.heading_rad + s * (curvature_1_m + 0.5 * slope_1_m2 * s)
            x += weight * part_m * cos(heading)
            y += weight * part_m * sin(heading)
    turn = length_m * (curvature_1_m + 0.5 * slope_1_m2 * length_m)
    return Pose(x, y, start.heading_rad + turn)


def vehicle_pose(
    path: Path,
    arc_length_m: float,
    heading_error_rad: float,
    lateral_error_m: float,
    preview_distance_m: float,
) -> Pose:
    """Return position of the vehicle's centre of gravity (CG) and heading.

    ``arc_length_m`` is that of the preview point, which is ``lateral_error_m`` to the left of the
    path there. The CG lies ``preview_distance_m`` behind it along the vehicle's own axis.
    """
    beside = pose(path, arc_length_m)
    heading = beside.heading_rad + heading_error_rad
    return Pose(
        beside.x_m - lateral_error_m * sin(beside.heading_rad) - preview_distance_m * cos(heading),
        beside.y_m + lateral_error_m * cos(beside.heading_rad) - preview_distance_m * sin(heading),
        heading,
    )
