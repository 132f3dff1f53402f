"""Deviation of the centre of gravity at every sample of a compiled run."""

from typing import Any

import numpy as np

from ..plant_emulator.deviation import deviation_behind_m
from .compilation import compiled


@compiled
def cg_deviations_m(
    path: Any, arc_length_m: Any, heading_error_rad: Any, lateral_error_m: Any, preview_m: float
) -> Any:
    """Return ``plant_emulator.deviation.cg_deviation_m`` of every sample, shape (samples,)."""
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
