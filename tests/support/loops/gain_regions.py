"""Judges the roots of a gain region again, at gains that the region was not made from."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely
from shapely.affinity import affine_transform

from steer_by_wire.closed_loop.parameter_space.d_stability import DStability
from steer_by_wire.closed_loop.parameter_space.gain_boundaries import Window
from steer_by_wire.closed_loop.parameter_space.gain_loop import GainLoop
from steer_by_wire.closed_loop.parameter_space.gain_regions import GainRegion
from steer_by_wire.runtime.array_types import FloatArray


class Verification(NamedTuple):
    """Gains at which the roots were judged again, and those where the region was wrong.

    ``wrong``  shape (n, 2)
    """

    inside: int
    outside: int
    wrong: FloatArray


def verified(
    region: GainRegion, loops: Sequence[GainLoop], spec: DStability, points: int, seed: int
) -> Verification:
    """Judge the roots at random gains in the window and on both sides of the region's edges.

    Half of the ``points`` are spread over the window; the others lie beside the edges, a
    thousandth of the window off. Those nearer to an edge than half of that are left out.
    """
    generator = np.random.default_rng(seed)
    window = region.window
    spread = window.origin + window.sides * generator.random((points // 2, 2))
    away = 1e-3
    beside = _beside(region, generator, points // 2, away)
    gains = np.concatenate([spread, beside])
    square, unit = _in_window(region.polygon, window), (gains - window.origin) / window.sides
    if not square.is_empty:
        far = shapely.distance(square.boundary, shapely.points(unit)) > 0.5 * away
        gains = gains[far & np.all((unit > 0.0) & (unit < 1.0), axis=1)]
    inside = shapely.contains_xy(region.polygon, gains)
    good = np.all([loop.satisfies(spec, gains) for loop in loops], axis=0)
    count = int(np.count_nonzero(inside))
    return Verification(count, len(gains) - count, gains[inside != good])


def _beside(
    region: GainRegion, generator: np.random.Generator, points: int, away: float
) -> FloatArray:
    """Return gains on either side of random places on the edges, ``away`` in window sides."""
    edge = _in_window(region.polygon, region.window).boundary
    if edge.is_empty:
        return np.empty((0, 2))
    along = generator.random(points // 2) * edge.length
    on_edge = shapely.get_coordinates(shapely.line_interpolate_point(edge, along))
    angle_rad = 2.0 * math.pi * generator.random(len(on_edge))
    offset = away * np.column_stack([np.cos(angle_rad), np.sin(angle_rad)])
    both = np.concatenate([on_edge + offset, on_edge - offset])
    return np.asarray(both * region.window.sides + region.window.origin)


def _in_window(shape: shapely.Geometry, window: Window) -> shapely.Geometry:
    """Return a shape of gains with the window as the unit square."""
    (x, y), (x_off, y_off) = 1.0 / window.sides, -window.origin / window.sides
    return affine_transform(shape, [x, 0.0, 0.0, y, x_off, y_off])
