"""Path as a compiled run reads it: the place of the vehicle, and the values of PATH_AHEAD."""

from typing import Any

import numpy as np

from ...plant_emulator.path.cg_deviation import deviation_behind_m
from .compilation import compiled, compiled_inside


@compiled
def cg_deviations_m(
    path: Any, arc_length_m: Any, heading_error_rad: Any, lateral_error_m: Any, preview_m: float
) -> Any:
    """Return ``path.cg_deviation.cg_deviation_m`` of every sample, shape (samples,)."""
    deviations_m = np.empty(len(arc_length_m))
    for sample in range(len(arc_length_m)):
        piece, along_m = _located(path, arc_length_m[sample])
        end_piece, end_along_m = _located(path, arc_length_m[sample] - preview_m)
        deviations_m[sample] = deviation_behind_m(
            path,
            piece,
            along_m,
            end_piece,
            end_along_m,
            heading_error_rad[sample],
            lateral_error_m[sample],
            preview_m,
        )
    return deviations_m


@compiled
def _located(path: Any, arc_length_m: Any) -> Any:
    """Return the piece that holds a point, and the point's distance from the piece's start [m]."""
    lap = arc_length_m // path.length_m if path.closed else 0.0
    in_lap_m = arc_length_m - lap * path.length_m
    piece = max(np.searchsorted(path.start_m, in_lap_m, "right") - 1, 0)
    return piece, in_lap_m - path.start_m[piece]


@compiled
def curvatures_ahead_1_m(
    path: Any, arc_lengths_m: Any, spacing_m: float, values: int, low_1_m: float, high_1_m: float
) -> Any:
    """Return ``sensors.path_ahead.curvatures_ahead_1_m`` of every place, shape (places, values)."""
    rows = np.empty((len(arc_lengths_m), values))
    for place in range(len(arc_lengths_m)):
        write_ahead_1_m(path, arc_lengths_m[place], spacing_m, rows[place], low_1_m, high_1_m)
    return rows


@compiled_inside
def write_ahead_1_m(
    path: Any, arc_length_m: float, spacing_m: float, row: Any, low_1_m: float, high_1_m: float
) -> None:
    """Write the values of one place into a row."""
    for index in range(len(row)):
        piece, along_m = _located(path, arc_length_m + index * spacing_m)
        slope_1_m2 = path.curvature_slope_1_m2[piece]
        curvature_1_m = path.curvature_1_m[piece] + slope_1_m2 * along_m
        row[index] = min(max(curvature_1_m, low_1_m), high_1_m)
