"""Path as a compiled run reads it: the place of the vehicle, and the values of PATH_AHEAD."""

from typing import Any

import numpy as np
from numba.extending import register_jitable

from ...plant_emulator.path.cg_deviation import deviation_behind_m
from ...plant_emulator.path.path import Path
from ...runtime.array_types import FloatArray, IntArray
from .compilation import compiled
from .inlined_functions import INLINE


def cg_deviations_m(
    path: Path,
    arc_length_m: FloatArray,
    heading_error_rad: FloatArray,
    lateral_error_m: FloatArray,
    preview_m: float,
) -> FloatArray:
    """Return ``path.cg_deviation.cg_deviation_m`` of every sample, shape (samples,)."""
    places = (*_located(path, arc_length_m), *_located(path, arc_length_m - preview_m))
    deviations_m = np.empty(len(arc_length_m))
    _fill(path, *places, heading_error_rad, lateral_error_m, preview_m, deviations_m)
    return deviations_m


@compiled
def _fill(
    path: Any, pieces: Any, along_m: Any, end_pieces: Any, end_along_m: Any,
    heading_error_rad: Any, lateral_error_m: Any, preview_m: float, deviations_m: Any,
) -> None:  # fmt: skip
    for sample in range(len(deviations_m)):
        deviations_m[sample] = deviation_behind_m(
            path,
            pieces[sample],
            along_m[sample],
            end_pieces[sample],
            end_along_m[sample],
            heading_error_rad[sample],
            lateral_error_m[sample],
            preview_m,
        )


def _located(path: Path, arc_length_m: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return the piece that holds each point, and its distance from the piece's start [m]."""
    if path.closed:
        arc_length_m = arc_length_m - arc_length_m // path.length_m * path.length_m
    start_m = np.asarray(path.start_m)
    pieces = np.maximum(np.searchsorted(start_m, arc_length_m, "right") - 1, 0)
    return pieces, arc_length_m - start_m[pieces]


@register_jitable(**INLINE)
def write_ahead_1_m(
    path: Any, arc_length_m: float, spacing_m: float, row: Any, low_1_m: float, high_1_m: float
) -> None:
    """Write the values of one place into a row, as ``path.path.curvature`` has them."""
    for index in range(len(row)):
        along_m = arc_length_m + index * spacing_m
        if path.closed:
            lap = along_m // path.length_m
            along_m -= lap * path.length_m
        piece, end = 0, len(path.start_m)
        while end - piece > 1:
            middle = (piece + end) // 2
            if path.start_m[middle] <= along_m:
                piece = middle
            else:
                end = middle
        slope_1_m2 = path.curvature_slope_1_m2[piece]
        curvature_1_m = path.curvature_1_m[piece] + slope_1_m2 * (along_m - path.start_m[piece])
        row[index] = min(max(curvature_1_m, low_1_m), high_1_m)
