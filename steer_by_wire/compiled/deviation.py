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
        lap = arc_length_m[sample] // path.length_m if path.closed else 0.0
        in_lap_m = arc_length_m[sample] - lap * path.length_m
        piece = max(np.searchsorted(path.start_m, in_lap_m, "right") - 1, 0)
        deviations_m[sample] = deviation_behind_m(
            path,
            piece,
            in_lap_m - path.start_m[piece],
            heading_error_rad[sample],
            lateral_error_m[sample],
            preview_m,
        )
    return deviations_m
