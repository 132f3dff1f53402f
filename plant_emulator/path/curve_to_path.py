"""Path from a smooth curve (x(t), y(t)): true arc length, linearly interpolated curvature.

The break points have equal distances in arc length from each kink of the curvature to the next, and
between two kinks their number is doubled until the interpolation is accurate enough. On a closed
curve without kinks, equal distances let the sum over them converge faster than any power, so that
one lap of the interpolated curvature turns by 2π.
"""

from collections.abc import Callable
from math import atan2
from typing import NamedTuple

import numpy as np

from ...runtime.array_types import FloatArray, IntArray
from .path import GAUSS, Path, Pose

CURVATURE_TOLERANCE = 1e-4
"""Largest error of the interpolated curvature, relative to the curve's largest curvature."""
CURVATURE_TOLERANCE_1_M = 1e-6
"""Or, for curves that hardly bend, its largest absolute error [1/m]."""

_PIECES_MIN = 64
_PER_SPAN_MIN = 4
_PIECES_MAX = 1 << 18
_CELLS_PER_KNOT = 16
_NEWTON_STEPS = 4
"""Linear interpolation starts Newton with an error below 1e-2 of a cell; each step squares it."""
_TURN_MISSED_MAX_RAD = 0.1
"""A heading that turns by more than its curvature implies has a cusp between two points."""


class TooSharpError(ValueError):
    """A curve that bends too sharply to be interpolated, between two of its knots.

    ``knot``  index of the first of the two
    """

    def __init__(self, knot: int) -> None:
        super().__init__("the path bends too sharply")
        self.knot = knot


class CurvePoints(NamedTuple):
    """Points of a curve and their first and second derivative by its parameter, as arrays."""

    x_m: FloatArray
    y_m: FloatArray
    dx: FloatArray
    dy: FloatArray
    ddx: FloatArray
    ddy: FloatArray


Curve = Callable[[FloatArray], CurvePoints]


@np.errstate(divide="ignore", invalid="ignore")
def path_along(curve: Curve, knots: FloatArray, *, closed: bool, has_kinks: bool) -> Path:
    """Return the path along a curve, from the first knot to the last.

    ``knots``      parameters in rising order, between which the curve is smooth
    ``has_kinks``  whether its curvature may have kinks at all knots, or has none

    A closed curve ends where and as it starts. Raises TooSharpError.
    """
    lengths = _ArcLength(curve, knots)
    ends_m = lengths.knots_m if has_kinks else lengths.knots_m[[0, -1]]
    spans_m = np.diff(ends_m)
    least = _PER_SPAN_MIN if _PER_SPAN_MIN * len(spans_m) < _PIECES_MAX // 2 else 1
    pieces = np.full(len(spans_m), least if has_kinks else _PIECES_MIN)
    while True:
        halves_m = _break_points_m(ends_m, 2 * pieces)
        points = curve(lengths.parameters(halves_m))
        curvature = _curvature(points)
        errors = np.abs(curvature[1::2] - 0.5 * (curvature[:-1:2] + curvature[2::2]))
        allowed = max(CURVATURE_TOLERANCE * np.abs(curvature).max(), CURVATURE_TOLERANCE_1_M)
        firsts = np.cumsum(pieces) - pieces
        # Within a piece, the error can be larger than at its midpoint.
        is_coarse = np.maximum.reduceat(errors, firsts) > 0.5 * allowed
        if not is_coarse.any():
            break
        pieces[is_coarse] *= 2
        if pieces.sum() > _PIECES_MAX:
            raise TooSharpError(int(np.argmax(pieces)))
    heading = np.unwrap(list(map(atan2, points.dy.tolist(), points.dx.tolist())))[::2]
    curvature = curvature[::2]
    step_m = np.repeat(spans_m / pieces, pieces)
    turn = 0.5 * step_m * (curvature[1:] + curvature[:-1])
    missed = np.abs(np.diff(heading) - turn)
    if not missed.max() <= _TURN_MISSED_MAX_RAD:  # not a number where it turns back on itself
        raise TooSharpError(int(np.repeat(np.arange(len(pieces)), pieces)[np.argmax(missed)]))
    *start_m, total_m = halves_m[::2].tolist()
    slopes = (np.diff(curvature) / step_m).tolist()
    poses = list(map(Pose, points.x_m[::2].tolist(), points.y_m[::2].tolist(), heading.tolist()))
    curvatures = curvature[:-1].tolist()
    if closed:
        lap_turn_rad = poses[-1].heading_rad - poses[0].heading_rad
        return Path(start_m, curvatures, slopes, poses[:-1], total_m, lap_turn_rad, True)
    # After the end of an open path the road continues straight.
    return Path([*start_m, total_m], [*curvatures, 0.0], [*slopes, 0.0], poses, total_m, 0.0, False)


def _break_points_m(ends_m: FloatArray, pieces: IntArray) -> FloatArray:
    """Return the arc lengths that divide each span into as many equal pieces [m]."""
    spans = zip(ends_m[:-1].tolist(), ends_m[1:].tolist(), pieces.tolist(), strict=True)
    inner = [np.linspace(begin_m, end_m, count, endpoint=False) for begin_m, end_m, count in spans]
    return np.concatenate([*inner, ends_m[-1:]])


def _curvature(points: CurvePoints) -> FloatArray:
    cross: FloatArray = points.dx * points.ddy - points.dy * points.ddx
    square: FloatArray = points.dx * points.dx + points.dy * points.dy
    return cross / (square * np.sqrt(square))


def _speed(points: CurvePoints) -> FloatArray:
    speed: FloatArray = np.sqrt(points.dx * points.dx + points.dy * points.dy)
    return speed


class _ArcLength:
    """Arc length as a function of a curve's parameter, and its inverse."""

    def __init__(self, curve: Curve, knots: FloatArray) -> None:
        self._curve = curve
        fractions = np.arange(_CELLS_PER_KNOT) / _CELLS_PER_KNOT
        inner = (knots[:-1, np.newaxis] + np.diff(knots)[:, np.newaxis] * fractions).ravel()
        self._cells = np.append(inner, knots[-1])
        pieces = self._between(self._cells[:-1], self._cells[1:])
        self._length_m = np.concatenate(([0.0], np.cumsum(pieces)))
        self.knots_m = self._length_m[::_CELLS_PER_KNOT]

    def parameters(self, wanted: FloatArray) -> FloatArray:
        """Return the parameters of points at rising arc lengths [m], from 0 to the whole length."""
        parameter: FloatArray = np.interp(wanted, self._length_m, self._cells)
        cell = np.searchsorted(self._cells, parameter, side="right") - 1
        cell = np.clip(cell, 0, len(self._cells) - 2)
        start = self._cells[cell]
        for _ in range(_NEWTON_STEPS):
            error = self._length_m[cell] + self._between(start, parameter) - wanted
            parameter = parameter - error / _speed(self._curve(parameter))
        parameter[0], parameter[-1] = self._cells[0], self._cells[-1]
        return parameter

    def _between(self, start: FloatArray, end: FloatArray) -> FloatArray:
        """Return the arc lengths from ``start`` to ``end``, each within one cell."""
        length = np.zeros_like(start)
        for node, weight in GAUSS:
            length = length + weight * _speed(self._curve(start + node * (end - start)))
        return length * (end - start)
