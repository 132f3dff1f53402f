"""The road to drive by hand: bends to both sides without end, gentle enough for 40 km/h."""

import math

from ...plant_emulator.path.ellipse_and_lane_changes import path_of_curvature
from ...plant_emulator.path.path import Path
from ...plant_emulator.path.settings import PathModel

_STRAIGHT_M = 40.0
_LENGTH_M = 6000.0
"""Ten minutes at 36 km/h; then it goes straight on."""
_POINT_M = 5.0
_WAVES = ((0.010, 110.0), (0.006, 67.0))
"""Curvature [1/m] and length [m] of the waves that add up to the bends."""


def winding_road(_own: None) -> Path:
    """Return the road: a straight to start on, then sums of sines, of at most 0.016 1/m."""
    count = round(_LENGTH_M / _POINT_M)
    bends = [
        (
            _STRAIGHT_M + number * _POINT_M,
            sum(k * math.sin(math.tau * number * _POINT_M / length) for k, length in _WAVES),
        )
        for number in range(count)
    ]
    return path_of_curvature([*bends, (_STRAIGHT_M + _LENGTH_M, 0.0)])


WINDING_ROAD = PathModel(winding_road)
