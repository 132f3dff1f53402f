"""A path through the points of a file: a cubic spline, sampled as in `path.curve_to_path`.

The file is CSV with the header ``x_m,y_m`` and one point per line; empty lines and lines that start
with ``#`` are skipped. The spline's curvature is continuous and the path meets every point.
"""

import math
from collections.abc import Sequence
from pathlib import Path as FilePath

import numpy as np
from scipy.interpolate import CubicSpline

from ...runtime.array_types import FloatArray
from ...runtime.settings import SettingsError, read_text
from .curve_to_path import CurvePoints, path_along
from .path import Path

HEADER = ["x_m", "y_m"]
POINTS_MIN = 4
POINTS_MAX = 10_000
COORDINATE_MAX_M = 1e6
DISTANCE_MIN_M = 1e-3
"""Smallest distance between neighbours: on a long path, nearer points would coincide."""


def waypoint_path(file: FilePath, *, closed: bool) -> Path:
    """Return the path through a file's points; a closed one returns from the last to the first.

    Raises SettingsError in one line that names the file and, where it can, the line in it.
    """
    points = _read(file)
    try:
        return path_through(points, closed=closed)
    except ValueError as error:
        raise SettingsError(f"{file}: {error}") from error


def path_through(points: Sequence[tuple[float, float]], *, closed: bool = False) -> Path:
    """Return the smooth path through points (x [m], y [m]): a cubic spline.

    ``closed``  whether it returns from the last point to the first

    Raises ValueError.

    >>> road = path_through([(0.0, 0.0), (10.0, 0.0), (20.0, 1.0), (30.0, 1.0)])
    >>> road.closed, round(road.length_m, 2)
    (False, 30.06)
    """
    points = [*points]
    if not POINTS_MIN <= len(points) <= POINTS_MAX:
        raise ValueError(f"must hold {POINTS_MIN} to {POINTS_MAX} points, not {len(points)}")
    if closed and points[0] != points[-1]:
        points = [*points, points[0]]
    xy = np.array(points)
    chords = np.sqrt(np.square(np.diff(xy, axis=0)).sum(axis=1))
    if chords.min() < DISTANCE_MIN_M:
        number = int(np.argmin(chords)) + 2
        raise ValueError(
            f"point {number} repeats the one before it, or is nearer than"
            f" {DISTANCE_MIN_M:g} m to it"
        )
    knots = np.concatenate(([0.0], np.cumsum(chords)))
    spline = CubicSpline(knots, xy, bc_type="periodic" if closed else "natural")
    first, second = spline.derivative(1), spline.derivative(2)

    def curve(t: FloatArray) -> CurvePoints:
        return CurvePoints(*spline(t).T, *first(t).T, *second(t).T)

    return path_along(curve, knots, closed=closed, has_kinks=True)


def _read(file: FilePath) -> list[tuple[float, float]]:
    lines = read_text(file).splitlines()
    rows = [
        (number, [cell.strip() for cell in line.split(",")])
        for number, line in enumerate(lines, start=1)
        if line.strip() and not line.startswith("#")
    ]
    if not rows or rows[0][1] != HEADER:
        raise SettingsError(f"{file}: must start with the header {','.join(HEADER)}")
    return [_point(file, number, cells) for number, cells in rows[1:]]


def _point(file: FilePath, number: int, cells: list[str]) -> tuple[float, float]:
    try:
        x, y = (float(cell) for cell in cells)
    except ValueError:
        x = y = math.nan
    if not (abs(x) <= COORDINATE_MAX_M and abs(y) <= COORDINATE_MAX_M):
        raise SettingsError(
            f"{file}: line {number}: must be two numbers within ±{COORDINATE_MAX_M:g}, "
            f"not {','.join(cells)!r}"
        )
    return x, y
