"""The data of the pictures of the gain plane: boundaries and regions, point by point."""

from collections.abc import Sequence

import numpy as np
import shapely

from ...loop_theory.gain_boundaries import Bound, BoundaryCurve, RootKind
from ...loop_theory.parameter_space import GainRegion
from ...runtime.array_types import FloatArray


def curve_columns(curves: Sequence[BoundaryCurve]) -> dict[str, FloatArray]:
    """Return every boundary, point by point; bound and root count the legend's from 1."""
    bounds, kinds = list(Bound), list(RootKind)
    labels = [(i, bounds.index(c.bound) + 1, kinds.index(c.kind) + 1) for i, c in enumerate(curves)]
    each = np.repeat(np.array(labels, dtype=np.float64), [len(c.gains) for c in curves], axis=0)
    gains = np.concatenate([curve.gains for curve in curves])
    s_rad_s = np.concatenate([curve.s_rad_s for curve in curves])
    return {
        "curve": each[:, 0],
        "bound_sigma_theta_r": each[:, 1],
        "root_complex_real_infinite": each[:, 2],
        "k_p_rad_m": gains[:, 0],
        "k_d_rad_s_m": gains[:, 1],
        "s_real_rad_s": s_rad_s.real,
        "s_imag_rad_s": s_rad_s.imag,
    }


def region_columns(regions: Sequence[GainRegion]) -> dict[str, FloatArray]:
    """Return the edge of every region, ring by ring."""
    rings = [
        (index, np.asarray(ring.coords))
        for index, region in enumerate(regions)
        for part in shapely.get_parts(region.polygon)
        for ring in (part.exterior, *part.interiors)
    ]
    gains = np.concatenate([ring for _, ring in rings])
    return {
        "region": np.concatenate([np.full(len(ring), float(index)) for index, ring in rings]),
        "ring": np.concatenate([np.full(len(ring), float(i)) for i, (_, ring) in enumerate(rings)]),
        "k_p_rad_m": gains[:, 0],
        "k_d_rad_s_m": gains[:, 1],
    }
