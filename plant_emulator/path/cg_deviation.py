"""Deviation of the centre of gravity (CG) from the path.

The lateral error on the bus is that of the preview point, d ahead of the CG. On a bend the two
differ by decimetres: a preview point held on the path leaves the CG inside it. In the frame of the
path at the preview point, x along it, the CG is at

    (-d cos Δψ, y - d sin Δψ)

The path is followed back by d, across whole pieces by its stored poses. That ends close to the
CG: at (e, w) in the frame of that end, with e some centimetres. The deviation is then
w - ρ e²/(2 (1 - ρ w)), to the third order of e.
"""

from math import cos, sin

from .path import Path, Pose, along_clothoid, locate

_TURN_SHORT_RAD = 0.05
_HERE = (0.0, 0.0, 0.0)
_NODE = 0.21132486540518712
"""Of two Gauss nodes from either end; over such a turn their error is 2e-9 of the length."""

Placed = tuple[float, float, float]
"""x [m], y [m] and heading [rad]: the values of a Pose."""


def cg_deviation_m(
    path: Path,
    arc_length_m: float,
    heading_error_rad: float,
    lateral_error_m: float,
    preview_m: float,
) -> float:
    """Return the distance of the CG from the path [m], to the left of it positive.

    ``arc_length_m``, ``heading_error_rad`` and ``lateral_error_m`` belong to the preview point.
    Before its start an open path is straight.
    """
    _, piece, along_m = locate(path, arc_length_m)
    _, end_piece, end_along_m = locate(path, arc_length_m - preview_m)
    return deviation_behind_m(
        path, piece, along_m, end_piece, end_along_m, heading_error_rad, lateral_error_m, preview_m
    )


def along_short(start: Placed, curvature_1_m: float, slope_1_m2: float, length_m: float) -> Placed:
    """Return the pose of ``along_clothoid``, by two Gauss nodes where the piece hardly turns."""
    start_x_m, start_y_m, heading_rad = start
    bend_rad = length_m * curvature_1_m
    turn_rad = length_m * (curvature_1_m + 0.5 * slope_1_m2 * length_m)
    if not (
        -_TURN_SHORT_RAD <= turn_rad <= _TURN_SHORT_RAD
        and -_TURN_SHORT_RAD <= bend_rad <= _TURN_SHORT_RAD
    ):
        begin = Pose(start_x_m, start_y_m, heading_rad)
        x_m, y_m, heading_rad = along_clothoid(begin, curvature_1_m, slope_1_m2, length_m)
        return x_m, y_m, heading_rad
    first_m, second_m = _NODE * length_m, (1.0 - _NODE) * length_m
    first_rad = heading_rad + first_m * (curvature_1_m + 0.5 * slope_1_m2 * first_m)
    second_rad = heading_rad + second_m * (curvature_1_m + 0.5 * slope_1_m2 * second_m)
    half_m = 0.5 * length_m
    x_m = start_x_m + half_m * (cos(first_rad) + cos(second_rad))
    y_m = start_y_m + half_m * (sin(first_rad) + sin(second_rad))
    return x_m, y_m, heading_rad + turn_rad


def deviation_behind_m(
    path: Path,
    piece: int,
    along_m: float,
    end_piece: int,
    end_along_m: float,
    heading_error_rad: float,
    lateral_error_m: float,
    preview_m: float,
) -> float:
    """Return the deviation for a preview point at ``along_m`` of a piece of the path.

    ``end_piece``, ``end_along_m``  of the point ``preview_m`` before; negative before an open path
    """
    curvatures_1_m, slopes_1_m2, poses = path.curvature_1_m, path.curvature_slope_1_m2, path.pose
    slope_1_m2 = slopes_1_m2[piece]
    curvature_1_m = curvatures_1_m[piece] + slope_1_m2 * along_m
    part_m = preview_m if preview_m < along_m else along_m
    end = along_short(_HERE, curvature_1_m, slope_1_m2, -part_m)
    if preview_m > along_m:
        start_1_m, slope_1_m2 = curvatures_1_m[end_piece], slopes_1_m2[end_piece]
        if end_along_m < 0.0:
            start_1_m = slope_1_m2 = 0.0
        curvature_1_m = start_1_m + slope_1_m2 * end_along_m
        start = poses[end_piece]  # in compiled code a row of an array, which is another type
        begin = start.x_m, start.y_m, start.heading_rad
        there = along_short(begin, start_1_m, slope_1_m2, end_along_m)
        end = _seen_from(poses[piece], end, there)
    else:
        curvature_1_m -= slope_1_m2 * part_m
    end_x_m, end_y_m, end_rad = end
    x_m = -preview_m * cos(heading_error_rad) - end_x_m
    y_m = lateral_error_m - preview_m * sin(heading_error_rad) - end_y_m
    cos_end, sin_end = cos(end_rad), sin(end_rad)
    ahead_m = x_m * cos_end + y_m * sin_end
    aside_m = y_m * cos_end - x_m * sin_end
    # Far off the path the expansion does not hold; the bounds keep it finite.
    if ahead_m > preview_m:
        ahead_m = preview_m
    elif ahead_m < -preview_m:
        ahead_m = -preview_m
    nearness = 1.0 - curvature_1_m * aside_m
    if nearness < 0.5:
        nearness = 0.5
    return aside_m - 0.5 * curvature_1_m * ahead_m * ahead_m / nearness


def _seen_from(start: Pose, seen: Placed, other: Placed) -> Placed:
    """Return another pose in the frame in which the pose ``start`` is ``seen``."""
    seen_x_m, seen_y_m, seen_rad = seen
    x_m, y_m, heading_rad = other
    turn_rad = seen_rad - start.heading_rad
    x_m, y_m = x_m - start.x_m, y_m - start.y_m
    cos_turn, sin_turn = cos(turn_rad), sin(turn_rad)
    x_seen_m = seen_x_m + x_m * cos_turn - y_m * sin_turn
    y_seen_m = seen_y_m + y_m * cos_turn + x_m * sin_turn
    return x_seen_m, y_seen_m, heading_rad + turn_rad
