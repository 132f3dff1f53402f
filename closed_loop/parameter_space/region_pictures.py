"""Drawings of the parameter space method: ∂Γ, its image in the plane of the gains, and regions."""
# ruff: noqa: RUF001  # σ is the paper's symbol

import math
from collections.abc import Sequence
from itertools import product

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.patches import PathPatch
from matplotlib.path import Path

from ..reports.plot_style import LINES
from .d_stability import DStability
from .gain_boundaries import Bound, BoundaryCurve, RootKind
from .gain_regions import GainRegion

GAIN_LABELS = {"xlabel": "K_p [rad/m]", "ylabel": "K_d [rad s/m]"}
REGION_COLOUR = "#0072B2"
_LINES = {
    (kind, bound): {**line, "color": colour}
    for ((kind, (bound, colour)), line) in zip(
        product(RootKind, zip(Bound, LINES.by_key()["color"], strict=False)), LINES, strict=False
    )
}


def draw_gamma(axes: Axes, spec: DStability) -> None:
    """Draw the three boundaries in the plane of the roots; shade where dominant roots may lie."""
    sigma, theta, radius = spec
    circle_rad = np.linspace(0.0, 2.0 * math.pi, 400)
    circle = radius * np.column_stack([np.cos(circle_rad), np.sin(circle_rad)])
    far = 4.0 * radius
    mouth = far * abs(math.tan(theta))
    allowed = shapely.intersection_all(
        [
            shapely.Polygon(circle),
            shapely.Polygon([(0.0, 0.0), (-far, mouth), (-far, -mouth)]),
            shapely.box(-far, -far, -sigma, far),
        ]
    )
    axes.fill(*allowed.exterior.xy, color="0.85", label="dominant roots allowed")
    axes.axvline(-sigma, **_LINES[RootKind.COMPLEX, Bound.SIGMA], label=f"σ = {sigma:g} 1/s")
    ray = np.array([0.0, far])
    for sign in (1.0, -1.0):
        axes.plot(
            ray * math.cos(theta),
            sign * ray * math.sin(theta),
            **_LINES[RootKind.COMPLEX, Bound.CONE],
            label=f"θ = {math.degrees(theta):g}°" if sign > 0.0 else None,
        )
    axes.plot(*circle.T, **_LINES[RootKind.COMPLEX, Bound.RADIUS], label=f"R = {radius:g} rad/s")
    axes.set(aspect="equal", xlim=(-1.6 * radius, 0.5 * radius), ylim=(-1.3 * radius, 1.3 * radius))
    axes.set(xlabel="Re s [rad/s]", ylabel="Im s [rad/s]")


def draw_curves(axes: Axes, curves: Sequence[BoundaryCurve]) -> None:
    """Draw boundaries: a colour for each demand, dashes for each demand and kind of root."""
    drawn = set()
    for curve in curves:
        key = f"{curve.bound}, {curve.kind} root"
        label = key if key not in drawn else None
        axes.plot(*curve.gains.T, **_LINES[curve.kind, curve.bound], label=label)
        drawn.add(key)


def fill_region(axes: Axes, region: GainRegion, label: str) -> None:
    """Fill a region, holes left out."""
    rings = [
        Path(np.asarray(ring.coords), closed=True)
        for part in shapely.get_parts(region.polygon)
        for ring in (part.exterior, *part.interiors)
    ]
    path = Path.make_compound_path(*rings) if rings else Path(np.empty((0, 2)))
    axes.add_patch(PathPatch(path, facecolor=REGION_COLOUR, alpha=0.25, lw=0.0, label=label))
