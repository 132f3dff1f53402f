"""Parameter space method: the gains (K_p, K_d) with which each of several loops is D-stable.

SAE 2018-01-1086, section V.A, after Ackermann. The boundaries of ``gain_boundaries`` cut the plane
of the gains into faces. A root crosses ∂Γ only on a boundary, so within a face the verdict is the
same everywhere:

    1. node the boundaries with each other and with the frame of the window, and polygonise them
    2. judge the roots at one point of every face
    3. unite the faces whose roots are where they should be

Several loops (the corners of an uncertainty box): intersect.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import MultiPolygon, Polygon
from shapely.affinity import affine_transform

from ...runtime.array_types import FloatArray
from .d_stability import DStability
from .gain_boundaries import Bound, BoundaryCurve, RootKind, Window, boundary_curves
from .gain_loop import GainLoop

_OVERSHOOT = 1e-5
"""How far an end of a curve is extended beyond the boundary it lies on, in window sides: more than
a curve deviates from its chords, so that it crosses. The piece beyond is no edge of a face."""
_GRID = 1e-9
"""Grid to which nodes are rounded, in window sides; it makes the arithmetic of areas robust."""
_FACE_AREA_MIN = 1e-10
"""Share of the window; a smaller face lies between two polylines of the same crossing."""


class Margin(NamedTuple):
    """Distance to one kind of boundary of the region.

    ``relative``  distance with each gain in units of its own value: 0.1 is a tenth of both
    """

    bound: Bound
    kind: RootKind
    relative: float


class GainRegion(NamedTuple):
    """Gains for which every loop is D-stable, K_p [rad/m] as x and K_d [rad s/m] as y.

    ``polygon``  the region within the window; may be empty
    ``curves``   every boundary in the window, of all loops
    """

    polygon: Polygon | MultiPolygon
    curves: tuple[BoundaryCurve, ...]
    window: Window

    def contains(self, k_p: float, k_d: float) -> bool:
        """Whether the gains are inside."""
        return bool(shapely.contains_xy(self.polygon, k_p, k_d))

    def margins(self, k_p: float, k_d: float) -> tuple[Margin, ...]:
        """Return the distance to each kind of boundary on the edge of the region, nearest first."""
        edge = shapely.buffer(self.polygon.boundary, 1e-5 * float(min(self.window.sides)))
        nearest: dict[tuple[Bound, RootKind], float] = {}
        for curve in self.curves:
            on_edge = shapely.intersection(shapely.LineString(curve.gains), edge)
            if on_edge.length > 1e-3 * float(min(self.window.sides)):
                scaled = _scaled(on_edge, 1.0 / k_p, 1.0 / k_d)
                distance = float(shapely.distance(scaled, shapely.Point(1.0, 1.0)))
                key = (curve.bound, curve.kind)
                nearest[key] = min(distance, nearest.get(key, math.inf))
        found = [Margin(*key, distance) for key, distance in nearest.items()]
        return tuple(sorted(found, key=lambda margin: margin.relative))


def d_stable_region(loops: Iterable[GainLoop], spec: DStability, window: Window) -> GainRegion:
    """Return the gains in the window for which every loop meets the specification."""
    square: Polygon | MultiPolygon = shapely.box(0.0, 0.0, 1.0, 1.0)
    curves: list[BoundaryCurve] = []
    for loop in loops:
        own = boundary_curves(loop, spec, window)
        curves.extend(own)
        faces = _faces(own, window, square)
        points = shapely.get_coordinates(shapely.point_on_surface(faces))
        good = faces[loop.satisfies(spec, points * window.sides + window.origin)]
        square = _areas(
            shapely.intersection(square, shapely.union_all(good, grid_size=_GRID), grid_size=_GRID)
        )
    polygon = _areas(shapely.make_valid(_scaled(square, *window.sides, *window.origin)))
    return GainRegion(polygon, tuple(curves), window)


def _faces(
    curves: Sequence[BoundaryCurve], window: Window, wanted: Polygon | MultiPolygon
) -> NDArray[np.object_]:
    """Return the faces into which the boundaries cut the unit square where they meet ``wanted``."""
    square = shapely.box(0.0, 0.0, 1.0, 1.0)
    lines = [shapely.LineString(_overshot(_unit(curve.gains, window))) for curve in curves]
    net = shapely.union_all([square.boundary, *lines], grid_size=_GRID)
    faces = shapely.get_parts(shapely.polygonize(shapely.get_parts(net)))
    inner = shapely.contains(square, shapely.point_on_surface(faces))
    large = shapely.area(faces) > _FACE_AREA_MIN
    shapely.prepare(wanted)
    return np.asarray(faces[inner & large & shapely.intersects(wanted, faces)])


def _overshot(points: FloatArray) -> FloatArray:
    """Return a polyline with both ends extended."""
    first, last = points[0] - points[1], points[-1] - points[-2]
    first, last = (_OVERSHOOT * end / max(np.hypot(*end), 1e-300) for end in (first, last))
    return np.concatenate([[points[0] + first], points, [points[-1] + last]])


def _unit(gains: FloatArray, window: Window) -> FloatArray:
    """Return gains with the window as the unit square."""
    return np.asarray((gains - window.origin) / window.sides)


def _scaled(
    shape: shapely.Geometry, x: float, y: float, x_off: float = 0.0, y_off: float = 0.0
) -> shapely.Geometry:
    return affine_transform(shape, [x, 0.0, 0.0, y, x_off, y_off])


def _areas(shape: shapely.Geometry) -> Polygon | MultiPolygon:
    """Return the areas of a shape, without the lines and points an intersection may leave."""
    parts = [part for part in shapely.get_parts(shape) if part.geom_type == "Polygon"]
    areas = shapely.union_all(parts)
    return Polygon() if areas.is_empty else areas
