"""A path through the points of a file: a cubic spline, sampled as in `path.curve_to_path`.

The file is a table with the columns ``x_m`` and ``y_m`` (``runtime.settings.number_table``). The
spline's curvature is continuous and the path meets every point. A point that repeats the one before
it, as a receiver at rest records it, is left out.
"""

from collections.abc import Sequence
from pathlib import Path as FilePath

import numpy as np
from scipy.interpolate import CubicSpline

from ...runtime.array_types import FloatArray
from ...runtime.settings import SettingsError
from ...runtime.settings.number_table import convert_cells, read_number_table
from .curve_to_path import CurvePoints, TooSharpError, path_along
from .path import Path, Pose

POINTS_MIN = 2
POINTS_MAX = 100_000
COORDINATE_MAX_M = 1e8
"""More than any coordinate of a map projection, such as the northing of UTM."""
SPACING_MIN_M = 1e-3
"""Nearer neighbours are one point: on a long path, they would coincide."""


class _PointError(ValueError):
    """Points that give no path; ``index`` is that of the point to look at."""

    def __init__(self, index: int, what: str) -> None:
        super().__init__(f"point {index + 1}: {what}")
        self.index, self.what = index, what


def waypoint_path(file: FilePath, *, closed: bool, spacing_min_m: float = SPACING_MIN_M) -> Path:
    """Return the path through a file's points; a closed one returns from the last to the first.

    ``spacing_min_m``  as of ``path_through``

    Raises SettingsError in one line that names the file and, where it can, the line in it.
    """
    _, rows = read_number_table(file, (("x_m", "y_m"),))
    points = list(convert_cells(file, rows, _coordinate, f"x_m,y_m within ±{COORDINATE_MAX_M:g}"))
    try:
        pairs = [(x, y) for x, y in points]
        return path_through(pairs, closed=closed, spacing_min_m=spacing_min_m)
    except _PointError as error:
        place = f"{file}, line {rows[error.index].line}"
        raise SettingsError(
            f"{place}: {error.what} (path.spacing_min_m leaves near points out)"
        ) from error
    except ValueError as error:
        raise SettingsError(f"{file}: {error}") from error


def path_through(
    points: Sequence[tuple[float, float]],
    *,
    closed: bool = False,
    spacing_min_m: float = SPACING_MIN_M,
) -> Path:
    """Return the smooth path through points (x [m], y [m]): a cubic spline.

    ``closed``         whether it returns from the last point to the first
    ``spacing_min_m``  a point nearer to the one kept before is left out

    Raises ValueError.

    >>> road = path_through([(0.0, 0.0), (10.0, 0.0), (20.0, 1.0), (30.0, 1.0)])
    >>> road.closed, round(road.length_m, 2)
    (False, 30.06)
    """
    kept = _apart(points, spacing_min_m)
    least = POINTS_MIN + closed
    if not least <= len(kept) <= POINTS_MAX:
        raise ValueError(
            f"must hold {least} to {POINTS_MAX} points that lie apart, not {len(kept)}"
        )
    if closed and points[kept[0]] != points[kept[-1]]:
        kept = [*kept, kept[0]]
    # Near zero: a spline through coordinates of a map would lose digits.
    origin_x_m, origin_y_m = points[0]
    xy = np.array([points[index] for index in kept]) - points[0]
    chords_m = np.sqrt(np.square(np.diff(xy, axis=0)).sum(axis=1))
    knots = np.concatenate(([0.0], np.cumsum(chords_m)))
    spline = CubicSpline(knots, xy, bc_type="periodic" if closed else "natural")
    first, second = spline.derivative(1), spline.derivative(2)

    def curve(t: FloatArray) -> CurvePoints:
        return CurvePoints(*spline(t).T, *first(t).T, *second(t).T)

    try:
        path = path_along(curve, knots, closed=closed, has_kinks=True)
    except TooSharpError as error:
        raise _PointError(kept[error.knot], f"{error} from here to the next point") from error
    poses = [Pose(x + origin_x_m, y + origin_y_m, heading) for x, y, heading in path.pose]
    return path._replace(pose=poses)


def _apart(points: Sequence[tuple[float, float]], spacing_min_m: float) -> list[int]:
    kept: list[int] = []
    for index, (x, y) in enumerate(points):
        if kept:
            last_x, last_y = points[kept[-1]]
            if (x - last_x) ** 2 + (y - last_y) ** 2 < spacing_min_m**2:
                continue
        kept.append(index)
    return kept


def _coordinate(cell: str) -> float:
    if not abs(value := float(cell)) <= COORDINATE_MAX_M:
        raise ValueError(cell)
    return value
