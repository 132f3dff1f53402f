"""The content of PATH_AHEAD: the path's curvature at equal distances ahead of the preview point."""

from math import ceil

from ...dbc.messages import CURVATURE_FIELDS, PathAhead, limits, resolutions
from ..path.path import Path, curvature

VALUES = len(CURVATURE_FIELDS)
_SPACINGS = limits(PathAhead)["path_spacing_m"]
_RESOLUTION_M = resolutions(PathAhead)["path_spacing_m"]
CURVATURES = limits(PathAhead)["curvature_0_1_m"]


def spacing_m(speed_m_s: float, reach_s: float) -> float:
    """Return the spacing with which the values reach so far ahead, as the wire carries it [m]."""
    wanted_m = speed_m_s * reach_s / (VALUES - 1)
    steps = ceil(min(max(wanted_m, _SPACINGS.minimum), _SPACINGS.maximum) / _RESOLUTION_M - 1e-9)
    return steps * _RESOLUTION_M


def curvatures_ahead_1_m(path: Path, arc_length_m: float, spacing_m: float) -> list[float]:
    """Return the values, clamped to the range of their signals."""
    low, high = CURVATURES
    return [
        min(max(curvature(path, arc_length_m + index * spacing_m), low), high)
        for index in range(VALUES)
    ]
