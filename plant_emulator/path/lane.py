"""The lane, with the path in its middle, and how far the corners of a body are beyond its edges.

A corner lies next to the body's axis, at its front or its rear: the deviation of that point from
the path, and half the width across, say where the corner is. This is exact on a straight, and on a
bend of 30 m to a centimetre. Floats or arrays.
"""

from typing import Any, NamedTuple

import numpy as np


class Lane(NamedTuple):
    """Half the lane, and the body: from its centre of gravity to front, rear and side [m]."""

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
