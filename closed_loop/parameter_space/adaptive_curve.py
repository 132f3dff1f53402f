"""A plane curve as a polyline, sampled as densely as it bends, in and near the unit square."""

from collections.abc import Callable, Iterator

import numpy as np

from ...runtime.array_types import BoolArray, FloatArray

MARGIN = 0.05
"""Margin around the unit square within which a curve is followed too."""
_CHORD_ERROR = 1e-6
_HALVINGS = 24


def adapted(
    at: Callable[[FloatArray], FloatArray], parameters: FloatArray
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Halve intervals near the unit square until their middle lies on the chord.

    Returns parameters, points, and which of the intervals between them belong to the curve.
    Intervals away from the square do not, nor those that halving does not straighten, such as
    across a pole.
    """
    points = at(parameters)
    open_, drawn = np.ones(len(points) - 1, np.bool_), np.ones(len(points) - 1, np.bool_)
    for _ in range(_HALVINGS):
        left = np.flatnonzero(open_)
        middles = 0.5 * (parameters[left] + parameters[left + 1])
        between = at(middles)
        before, after = points[left], points[left + 1]
        lowest = np.minimum(np.minimum(before, after), between)
        highest = np.maximum(np.maximum(before, after), between)
        near = np.all((lowest <= 1.0 + MARGIN) & (highest >= -MARGIN), axis=1)
        bent = near & ~(_off_chord(before, between, after) <= _CHORD_ERROR)
        drawn[left] = near
        open_[:] = False
        open_[left] = bent
        split = left[bent]
        if not len(split):
            return parameters, points, drawn
        parameters = np.insert(parameters, split + 1, middles[bent])
        points = np.insert(points, split + 1, between[bent], axis=0)
        drawn = np.insert(drawn, split + 1, True)
        open_ = np.insert(open_, split + 1, True)
    return parameters, points, drawn & ~open_


def _off_chord(before: FloatArray, between: FloatArray, after: FloatArray) -> FloatArray:
    """Return the distances of points from the straight lines between their neighbours."""
    chord, offset = after - before, between - before
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        along = np.clip(np.sum(offset * chord, axis=1) / np.sum(chord**2, axis=1), 0.0, 1.0)
        along = np.where(np.isnan(along), 0.0, along)
        return np.asarray(np.hypot(*(offset - along[:, None] * chord).T))


def runs(drawn: BoolArray) -> Iterator[tuple[int, int]]:
    """Return (first, last + 1) of each run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], drawn, [False]]).astype(np.int8)))
    yield from zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
