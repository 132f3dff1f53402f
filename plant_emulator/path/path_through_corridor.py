"""The path through the corridor of ISO 3888-1, which a vehicle can follow without touching a cone.

It changes lanes more gently than `double_lane_change`: it begins before the cones of a section end,
and ends beyond the first ones of the next.
"""

from functools import lru_cache

import numpy as np

from .corridor import body_outside, cones_and_body
from .ellipse_and_lane_changes import lane_change, path_of_curvature
from .path import Path, pose
from .settings import CorridorSettings

_KEPT = 8
"""Paths cached for the next run: each takes about 30 ms to compute."""
_STEP_M, _HALVINGS = 0.5, 8
"""Of the search: between two places, and of the interval."""


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
