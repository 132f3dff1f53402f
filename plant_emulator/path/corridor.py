"""The corridor of ISO 3888-1, a double lane change between cones, and a lane: is a body in it?

    section      1             2    3             4    5             6
    length [m]   15            30   25            25   15            15
    width [m]    1.1 b + 0.25  -    1.2 b + 0.25  -    1.3 b + 0.25  1.3 b + 0.25

    b   width of the vehicle

ISO 3888-1:2018. Sections 2 and 4 have no cones, and no edge that could be
left. The lane offset of 3.5 m is taken from the right edge of section 1, with which those of
sections 5 and 6 are in line, to that of section 3.

The body is a rectangle. It is outside where a side of it is beyond an edge between the first and
the last cone of a section: at a corner, or at a cone next to it.

The path through the corridor changes lanes more gently than `double_lane_change`: it begins before
the cones of a section end, and ends beyond the first ones of the next.
"""

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from .ellipse_and_lane_changes import lane_change, path_of_curvature
from .path import Path, Pose, pose, vehicle_pose
from .settings import CorridorSettings, PathSettings

_LENGTHS_M = (15.0, 30.0, 25.0, 25.0, 15.0, 15.0)
_WIDTHS = {1: 1.1, 3: 1.2, 5: 1.3, 6: 1.3}
"""Of the sections with cones, over the width of the vehicle."""
_WIDER_M = 0.25
CORRIDOR_M = sum(_LENGTHS_M)
_LONGER_M = 5.0
"""The path through the corridor is longer than the road by less."""
_KEPT = 8
"""Paths cached for the next run: each takes about 30 ms to compute."""
_STEP_M, _HALVINGS = 0.5, 8
"""Of the search for that path: between two places, and of the interval."""


class Section(NamedTuple):
    """A section with cones; along the road from the path's start, and across it to the left."""

    number: int
    from_m: float
    to_m: float
    right_m: float
    left_m: float


class Corridor(NamedTuple):
    """The sections with cones, and the body: from its centre of gravity to front, rear and side."""

    sections: tuple[Section, ...]
    front_m: float
    rear_m: float
    side_m: float


class Outside(NamedTuple):
    """Where a body was farthest beyond an edge, in order of that distance.

    ``outside_m``  beyond the edge; negative within, and minus infinity between the sections
    ``at_m``       along the road from the first cone
    """

    outside_m: float
    section: int = 0
    at_m: float = 0.0


BETWEEN = Outside(-math.inf)


def corridor_of(settings: PathSettings) -> Corridor | None:
    """Return the corridor of a path, if it has one."""
    return cones_and_body(settings) if isinstance(settings, CorridorSettings) else None


def cones_and_body(settings: CorridorSettings) -> Corridor:
    """Return the corridor for a vehicle's width."""
    right_m = -0.5 * _width_m(settings, 1)
    sections, from_m = [], settings.start_m
    for number, length_m in enumerate(_LENGTHS_M, start=1):
        if number in _WIDTHS:
            edge_m = right_m + (settings.offset_m if number == 3 else 0.0)
            edges = edge_m, edge_m + _width_m(settings, number)
            sections.append(Section(number, from_m, from_m + length_m, *edges))
        from_m += length_m
    body = settings.front_m, settings.rear_m, 0.5 * settings.width_m
    return Corridor(tuple(sections), *body)


def _width_m(settings: CorridorSettings, number: int) -> float:
    return _WIDTHS[number] * settings.width_m + _WIDER_M


def body_outside(corridor: Corridor, body: Pose) -> Outside:
    """Return how far a body with this pose of its centre of gravity is beyond an edge."""
    cos, sin = math.cos(body.heading_rad), math.sin(body.heading_rad)
    worst = BETWEEN
    for side_m in (corridor.side_m, -corridor.side_m):
        x_m, y_m = body.x_m - side_m * sin, body.y_m + side_m * cos
        ends = x_m - corridor.rear_m * cos, x_m + corridor.front_m * cos
        for section in corridor.sections:
            if max(ends) < section.from_m or min(ends) > section.to_m:
                continue
            for end_m in ends:
                at_m = min(max(end_m, section.from_m), section.to_m)
                across_m = y_m + (at_m - x_m) * math.tan(body.heading_rad)
                outside_m = max(across_m - section.left_m, section.right_m - across_m)
                entered_m = at_m - corridor.sections[0].from_m
                worst = max(worst, Outside(outside_m, section.number, entered_m))
    return worst


def outside_at(
    corridor: Corridor,
    path: Path,
    arc_length_m: float,
    heading_error_rad: float,
    lateral_error_m: float,
    preview_m: float,
) -> Outside:
    """Return how far the body is outside, for a sample of the preview point."""
    before_m = arc_length_m + corridor.front_m - corridor.sections[0].from_m
    beyond_m = arc_length_m - preview_m - corridor.rear_m - corridor.sections[-1].to_m
    if before_m < 0.0 or beyond_m > _LONGER_M:
        return BETWEEN
    where = arc_length_m, heading_error_rad, lateral_error_m, preview_m
    return body_outside(corridor, vehicle_pose(path, *where))


@lru_cache(maxsize=_KEPT)
def through_corridor(settings: CorridorSettings) -> Path:
    """Return the path with the longest lane changes that leave half of the free space.

    A body that follows it with its centre of gravity keeps half of what the narrowest section
    leaves to every edge.
    """
    corridor = cones_and_body(settings)
    first, third, fifth, _ = corridor.sections
    free_m = 0.5 * (first.left_m - first.right_m) - corridor.side_m
    middle_m = [0.5 * (section.left_m + section.right_m) for section in (first, third, fifth)]

    def eased(by_m: float) -> Path:
        """Return the path whose lane changes are longer by this at either end."""
        out_m = third.from_m - first.to_m + 2.0 * by_m
        way_out = lane_change(first.to_m - by_m, middle_m[1] - middle_m[0], out_m)
        back_at_m = way_out[-1][0] + third.to_m - third.from_m - 2.0 * by_m
        back_m = fifth.from_m - third.to_m + 2.0 * by_m
        return path_of_curvature(
            way_out + lane_change(back_at_m, middle_m[2] - middle_m[1], back_m)
        )

    def keeps_free(path: Path) -> bool:
        places = np.arange(first.from_m - corridor.front_m, path.length_m + 1.0, _STEP_M).tolist()
        worst = max(body_outside(corridor, pose(path, at_m)) for at_m in places)
        return worst.outside_m <= -0.5 * free_m

    low_m, high_m = 0.0, 0.5 * (third.to_m - third.from_m)
    for _ in range(_HALVINGS):
        by_m = 0.5 * (low_m + high_m)
        low_m, high_m = (by_m, high_m) if keeps_free(eased(by_m)) else (low_m, by_m)
    return eased(low_m)


class Lane(NamedTuple):
    """Half the lane, and the body: from its centre of gravity to front, rear and side [m].

    The path is in the middle of the lane.
    """

    half_m: float
    front_m: float
    rear_m: float
    side_m: float


def beyond_lane_m(
    lane: Lane,
    preview_m: float,
    heading_error_rad: Any,
    lateral_error_m: Any,
    curvature_1_m: Any,
    rear_deviation_m: Any,
) -> Any:
    """Return how far the farthest corner is beyond an edge; negative within the lane.

    A corner lies next to the body's axis, at its front or its rear: the deviation of that point
    from the path, and half the width across, say where the corner is. This is exact on a straight,
    and on a bend of 30 m to a centimetre. Floats or arrays.

    ``curvature_1_m``, ``heading_error_rad`` and ``lateral_error_m`` belong to the preview point,
    ``rear_deviation_m`` to the point of the axis at the rear end: ``cg_deviation_m`` behind it.
    """
    psi, rho, ahead_m = heading_error_rad, curvature_1_m, lane.front_m - preview_m
    along_m = ahead_m * np.cos(psi)
    front_m = lateral_error_m + ahead_m * np.sin(psi) - 0.5 * rho * along_m * along_m
    front_side_m = lane.side_m * np.cos(psi - rho * ahead_m)
    rear_side_m = lane.side_m * np.cos(psi + rho * (preview_m + lane.rear_m))
    farthest_m = np.maximum(np.abs(front_m) + front_side_m, np.abs(rear_deviation_m) + rear_side_m)
    return farthest_m - lane.half_m
