"""Boundary crossing: where in the plane of the gains (K_p, K_d) a root of the loop sits on ∂Γ.

∂Γ is the boundary of the D-stable set of roots s. A root sits on it where

    K_p + K_d s = f(s),   f = -1/P,   s on ∂Γ               (parameter_space.gain_loop)

    complex root    s not real: real and imaginary part are two equations,
                    K_d = Im f/Im s,  K_p = Re f - K_d Re s:      one point for each s, a curve
    real root       s real: one equation, a straight line; s = -σ and s = -R

(J. Ackermann, Robust Control: Systems with Uncertain Physical Parameters, 1993.) No grid of gains
is searched. The σ line, the cone and the circle are followed only where a crossing can change the
verdict of ``judge``: the cone within R, and cone and circle left of -σ.

A curve is sampled adaptively in the window (``_adapted``). Ends of curves lie on other
boundaries. Off the real axis a curve is followed a little beyond its end; on the axis the limit is
taken. So rounding leaves no gap in the net of boundaries.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from ...runtime.array_types import BoolArray, ComplexArray, FloatArray
from .d_stability import DStability
from .gain_loop import GainLoop

_OVERLAP = 1e-3  # by which a piece of ∂Γ is followed beyond its end
_STEP = 1e-3  # from the real axis, of the smallest length at hand
_PER_DECADE = 60
_FAR = 1e7  # of R, where the curve of σ ends
_MARGIN = 0.05
"""Margin around the unit square within which a curve is followed too."""
_CHORD_ERROR = 1e-6
_HALVINGS = 24


class Bound(StrEnum):
    """Which of the demands."""

    SIGMA = "σ"  # noqa: RUF001  # the paper's symbol
    CONE = "θ"
    RADIUS = "R"


class RootKind(StrEnum):
    """How a root crosses the boundary."""

    COMPLEX = "complex"
    REAL = "real"


class Window(NamedTuple):
    """The part of the plane of the gains that is examined; K_p [rad/m], K_d [rad s/m]."""

    k_p_min: float
    k_p_max: float
    k_d_min: float
    k_d_max: float

    @property
    def origin(self) -> FloatArray:
        """Return the corner with the smallest gains."""
        return np.array([self.k_p_min, self.k_d_min])

    @property
    def sides(self) -> FloatArray:
        """Return the lengths of the sides, by which gains are made comparable."""
        return np.array([self.k_p_max - self.k_p_min, self.k_d_max - self.k_d_min])


class BoundaryCurve(NamedTuple):
    """One connected boundary in the window.

    ``gains``  (K_p, K_d), shape (n, 2): a polyline, n = 2 for a straight line
    """

    bound: Bound
    kind: RootKind
    gains: FloatArray


class _End(NamedTuple):
    """The end of a piece of ∂Γ on the real axis, where the two equations become one.

    The gains there, where the piece's parameter is 0, are extrapolated from one and two steps away.
    With its mirror image a piece is even in the distance, so the error of a point falls with the
    distance squared.
    """

    step: float
    mirrored: bool


class _Piece(NamedTuple):
    """A piece of ∂Γ off the real axis: s of a parameter, first samples, its end on the axis."""

    bound: Bound
    s_of: Callable[[FloatArray], ComplexArray]
    first: FloatArray
    start: _End | None


def boundary_curves(loop: GainLoop, spec: DStability, window: Window) -> tuple[BoundaryCurve, ...]:
    """Return every boundary of the loop that passes through the window."""
    complex_roots = [
        curve for piece in _pieces(loop, spec, window) for curve in _followed(loop, piece, window)
    ]
    return (*complex_roots, *_straight_lines(loop, spec, window))


def gains_of(loop: GainLoop, s_rad_s: ComplexArray) -> FloatArray:
    """Return the gains (K_p, K_d) that put a root at each s off the real axis, shape (n, 2)."""
    wanted = loop.critical(s_rad_s)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        k_d = wanted.imag / s_rad_s.imag
        return np.column_stack([wanted.real - k_d * s_rad_s.real, k_d])


class GainLine(NamedTuple):
    """The straight line K_p + slope K_d = constant, on which a real root is at s = slope."""

    constant: float
    slope: float


def real_root_line(loop: GainLoop, s_rad_s: float) -> GainLine | None:
    """Return where a real s is a root; None where no gains make it one."""
    wanted = float(loop.critical(np.array([s_rad_s], dtype=np.complex128))[0].real)
    return GainLine(wanted, s_rad_s) if math.isfinite(wanted) else None


def _pieces(loop: GainLoop, spec: DStability, window: Window) -> Iterator[_Piece]:
    """Return ∂Γ of the upper half-plane, off the real axis."""
    sigma, theta, radius = spec
    step = _STEP * (sigma or radius)

    def on_sigma(omega_rad_s: FloatArray) -> ComplexArray:
        return np.asarray(-sigma + 1j * omega_rad_s, dtype=np.complex128)

    def on_cone(distance_rad_s: FloatArray) -> ComplexArray:
        return np.asarray(distance_rad_s * np.exp(1j * theta), dtype=np.complex128)

    def on_circle(angle_rad: FloatArray) -> ComplexArray:
        return np.asarray(-radius * np.exp(-1j * angle_rad), dtype=np.complex128)

    first = _first_samples(loop, on_sigma, step, _FAR * radius, window)
    yield _Piece(Bound.SIGMA, on_sigma, first, _End(step, mirrored=True))

    start, end = sigma / -math.cos(theta) * (1.0 - _OVERLAP), radius * (1.0 + _OVERLAP)
    if start < end:
        apex = None if sigma else _End(step, mirrored=False)
        first = _first_samples(loop, on_cone, max(start, step), end, window)
        yield _Piece(Bound.CONE, on_cone, first, apex)

    widest = math.acos(sigma / radius) * (1.0 + _OVERLAP)
    first = np.linspace(_STEP, widest, 4 * _PER_DECADE)
    yield _Piece(Bound.RADIUS, on_circle, first, _End(_STEP, mirrored=True))


def _first_samples(
    loop: GainLoop,
    s_of: Callable[[FloatArray], ComplexArray],
    start: float,
    end: float,
    window: Window,
) -> FloatArray:
    """Return first samples from start to end [rad/s].

    No curve is in the window beyond the last s where |K_p| + |K_d s| of the window's corners
    reaches |f|, and none is followed there.
    """
    ratios = np.geomspace(start, end, 2 + int(_PER_DECADE * math.log10(end / start)))
    s = s_of(ratios)
    k_p, k_d = np.abs([window.origin, window.origin + window.sides]).max(axis=0)
    reach = (1.0 + _MARGIN) * (k_p + k_d * np.abs(s))
    beyond = np.abs(loop.critical(s)) > reach
    samples = len(ratios) - int(np.argmin(beyond[::-1])) if not beyond.all() else 0
    return ratios[: samples + 1]


def _followed(loop: GainLoop, piece: _Piece, window: Window) -> Iterator[BoundaryCurve]:
    """Return the runs of a complex root boundary that pass through the window."""

    def at(parameters: FloatArray) -> FloatArray:
        return (gains_of(loop, piece.s_of(parameters)) - window.origin) / window.sides

    points, drawn = _adapted(at, piece.first)
    apex = piece.start
    if apex is not None and math.isclose(piece.first[0], apex.step, rel_tol=1e-9):
        limit = _limit(at, apex) * window.sides + window.origin
        limit = _on_line(limit, real_root_line(loop, float(piece.s_of(np.zeros(1))[0].real)))
        points = np.insert(points, 0, (limit - window.origin) / window.sides, axis=0)
        drawn = np.insert(drawn, 0, True)
    for start, stop in _runs(drawn):
        gains = points[start : stop + 1] * window.sides + window.origin
        yield BoundaryCurve(piece.bound, RootKind.COMPLEX, gains)


def _limit(at: Callable[[FloatArray], FloatArray], end: _End) -> FloatArray:
    """Return the point at an end on the real axis."""
    one, two = at(end.step * np.array([1.0, 2.0]))
    return np.asarray(one - (two - one) / (3.0 if end.mirrored else 1.0))


def _on_line(gains: FloatArray, line: GainLine | None) -> FloatArray:
    """Return the gains moved onto a straight line, to remove rounding errors.

    The limit along a curve is not exact, but it has to lie on the line for the faces to close.
    """
    if line is None:
        return gains
    return np.array([line.constant - line.slope * gains[1], gains[1]])


def _straight_lines(loop: GainLoop, spec: DStability, window: Window) -> Iterator[BoundaryCurve]:
    """Return the real root boundaries in the window."""
    for bound, s_rad_s in ((Bound.SIGMA, -spec.sigma_1_s), (Bound.RADIUS, -spec.radius_rad_s)):
        line = real_root_line(loop, s_rad_s)
        ends = None if line is None else _clipped(line, window)
        if ends is not None:
            yield BoundaryCurve(bound, RootKind.REAL, ends)


def _clipped(line: GainLine, window: Window) -> FloatArray | None:
    """Return the two ends of a straight line on the window enlarged by the margin, else None."""
    normal = np.array([1.0, line.slope])
    slope, constant = normal * window.sides, float(normal @ window.origin) - line.constant
    low, high = -_MARGIN, 1.0 + _MARGIN
    crossings = []
    for axis in (0, 1):
        if slope[1 - axis]:
            for value in (low, high):
                other = -(constant + slope[axis] * value) / slope[1 - axis]
                if low <= other <= high:
                    crossings.append((value, other) if axis == 0 else (other, value))
    if len(crossings) < 2:
        return None
    ends = np.array([min(crossings), max(crossings)])
    return ends * window.sides + window.origin


def _adapted(
    at: Callable[[FloatArray], FloatArray], parameters: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Sample a plane curve as densely as it bends, in and near the unit square.

    Intervals are halved until their middle lies on the chord. Returns points, and which
    of the intervals between them belong to the curve. Intervals away from the square do not, nor
    those that halving does not straighten, such as across a pole.
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
        near = np.all((lowest <= 1.0 + _MARGIN) & (highest >= -_MARGIN), axis=1)
        bent = near & ~(_off_chord(before, between, after) <= _CHORD_ERROR)
        drawn[left] = near
        open_[:] = False
        open_[left] = bent
        split = left[bent]
        if not len(split):
            return points, drawn
        parameters = np.insert(parameters, split + 1, middles[bent])
        points = np.insert(points, split + 1, between[bent], axis=0)
        drawn = np.insert(drawn, split + 1, True)
        open_ = np.insert(open_, split + 1, True)
    return points, drawn & ~open_


def _off_chord(before: FloatArray, between: FloatArray, after: FloatArray) -> FloatArray:
    """Return the distances of points from the straight lines between their neighbours."""
    chord, offset = after - before, between - before
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        along = np.clip(np.sum(offset * chord, axis=1) / np.sum(chord**2, axis=1), 0.0, 1.0)
        along = np.where(np.isnan(along), 0.0, along)
        return np.asarray(np.hypot(*(offset - along[:, None] * chord).T))


def _runs(drawn: BoolArray) -> Iterator[tuple[int, int]]:
    """Return (first, last + 1) of each run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], drawn, [False]]).astype(np.int8)))
    yield from zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
