"""Figures 7 and 8: D-stability boundaries and region of (K_p, K_d).

The paper designs for the continuous nominal loop alone.
"""

import math
from itertools import product

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ....closed_loop.parameter_space.d_stability import DStability, judge, paper_d_stability
from ....closed_loop.parameter_space.gain_boundaries import (
    Bound,
    RootKind,
    boundary_curves,
    closed_loop_roots,
    meets_demands,
)
from ....closed_loop.reports.law_colours import COLOURS
from ....closed_loop.reports.plot_style import LINES
from ....controller.filters.nominal_model import paper_eq19
from ....runtime.array_types import ComplexArray
from ..result import Comparison, Picture, Reproduction, Verdict

# ruff: noqa: RUF001  # σ is the paper's symbol


PUBLISHED_K_P_RAD_M = 1.0596
PUBLISHED_K_D_RAD_S_M = 0.939
_K_P_RAD_M, _K_D_RAD_S_M = (-0.5, 3.5), (-0.6, 2.4)
"""The part of the plane of the gains that is shown."""
_GRID = 400
_PUBLISHED_GAINS = np.array([[PUBLISHED_K_P_RAD_M, PUBLISHED_K_D_RAD_S_M]])
_READING = (
    "R is read as bounding the two roots nearest the origin. No gains at all bring all four within"
    " 1.3 rad/s: their sum, -(459.2 + 227.6 K_d) rad/s, alone asks for K_d near -2. Every root has"
    " to be left of -σ, every root within R inside the cone. The boundaries are found by crossing"
    " ∂Γ, not by gridding."
)


def figure_7() -> Reproduction:
    """Return ∂Γ with the roots of the published loop, and its image in the plane of the gains."""
    spec = paper_d_stability()
    roots_rad_s = _published_roots()
    figure = Figure(figsize=(10.5, 5.6))
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.35))
    _draw_gamma(left, spec)
    near = roots_rad_s[np.abs(roots_rad_s) < 3.0]
    left.plot(near.real, near.imag, "x", color="black", ms=8, mew=2, label="published loop")
    left.legend(loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=2)
    left.set_title("∂Γ in the plane of the roots")
    _draw_curves(right, spec)
    right.set_title("Its image in the plane of the gains")
    right.legend(loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=3)
    pair, others = roots_rad_s[0], roots_rad_s[2:]
    judged = judge(spec, roots_rad_s)
    return Reproduction(
        "figure_07",
        "D-stability boundaries",
        "Plant (19), continuous, C = K_p + K_d s; σ = 0.3 1/s, θ = 135°, R = 1.3 rad/s.",
        (Picture("figure_07", figure),),
        (
            Comparison(
                "their damping ratio",
                f"at least {-math.cos(spec.cone_angle_rad):.3f} (θ)",
                f"{-pair.real / abs(pair):.3f}",
                bool(judged.damped),
            ),
            Comparison(
                "their modulus",
                f"at most {spec.radius_rad_s:g} rad/s (R)",
                f"{abs(pair):.3f} rad/s",
                bool(judged.dominant),
            ),
            Comparison(
                "largest real part of any root",
                f"below {-spec.sigma_1_s:g} 1/s (σ)",
                f"{max(roots_rad_s.real):.3f} 1/s",
                bool(judged.settled),
            ),
            Comparison(
                "the other roots",
                f"read literally, within {spec.radius_rad_s:g} rad/s too",
                " and ".join(f"{root.real:.1f}" for root in others) + " rad/s",
                None,
            ),
        ),
        _verdict(bool(judged.satisfied)),
        _READING,
    )


def figure_8() -> Reproduction:
    """Return the gains for which the nominal loop is D-stable, and where the published ones are."""
    spec = paper_d_stability()
    inside = meets_demands([paper_eq19()], spec, PUBLISHED_K_P_RAD_M, PUBLISHED_K_D_RAD_S_M)
    figure = Figure(figsize=(8.5, 5.4))
    axes = figure.subplots()
    k_p, k_d = np.meshgrid(*(np.linspace(*ends, _GRID) for ends in (_K_P_RAD_M, _K_D_RAD_S_M)))
    roots = closed_loop_roots(paper_eq19(), np.column_stack([k_p.ravel(), k_d.ravel()]))
    is_stable = judge(spec, roots).satisfied.reshape(k_p.shape)
    axes.contourf(k_p, k_d, is_stable, levels=[0.5, 1.5], colors=[COLOURS[1]], alpha=0.25)
    _draw_curves(axes, spec)
    axes.set_title("D-stable gains of the nominal loop: shaded")
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return Reproduction(
        "figure_08",
        "Overall solution region",
        "Plant (19), continuous, C = K_p + K_d s; σ = 0.3 1/s, θ = 135°, R = 1.3 rad/s; published"
        f" gains K_p = {PUBLISHED_K_P_RAD_M}, K_d = {PUBLISHED_K_D_RAD_S_M}. The region goes on"
        " above the picture.",
        (Picture("figure_08", figure),),
        (
            Comparison(
                "published gains", "in the region", "inside" if inside else "outside", inside
            ),
        ),
        _verdict(inside),
        _READING,
    )


def _published_roots() -> ComplexArray:
    """Return the roots at the published gains, nearest the origin first, Im > 0 before Im < 0."""
    roots_rad_s = closed_loop_roots(paper_eq19(), _PUBLISHED_GAINS)[0]
    order = np.lexsort((-roots_rad_s.imag, np.round(np.abs(roots_rad_s), 9)))
    return np.asarray(roots_rad_s[order])


_LINES = dict(zip(product(RootKind, Bound), LINES, strict=False))
"""A line of its own for each kind of root and each demand."""


def _draw_gamma(axes: Axes, spec: DStability) -> None:
    """Draw the three boundaries in the plane of the roots; shade where dominant roots may lie."""
    sigma, theta, radius = spec
    half_rad = math.pi - theta
    arc_rad = np.linspace(-half_rad, half_rad, 200)
    corner = sigma * math.tan(half_rad)
    x, y = -radius * np.cos(arc_rad), radius * np.sin(arc_rad)
    allowed = [*x, -sigma, -sigma], [*y, corner, -corner]
    axes.fill(*allowed, color="0.85", label="dominant roots allowed")
    line = {bound: _LINES[RootKind.COMPLEX, bound] for bound in Bound}
    axes.axvline(-sigma, **line[Bound.SIGMA], label=f"σ = {sigma:g} 1/s")
    ray = np.array([0.0, 4.0 * radius])
    for sign, label in ((1.0, f"θ = {math.degrees(theta):g}°"), (-1.0, None)):
        ends = ray * math.cos(theta), sign * ray * math.sin(theta)
        axes.plot(*ends, **line[Bound.CONE], label=label)
    circle_rad = np.linspace(0.0, 2.0 * math.pi, 400)
    circle = radius * np.cos(circle_rad), radius * np.sin(circle_rad)
    axes.plot(*circle, **line[Bound.RADIUS], label=f"R = {radius:g} rad/s")
    axes.set(aspect="equal", xlim=(-1.6 * radius, 0.5 * radius), ylim=(-1.3 * radius, 1.3 * radius))
    axes.set(xlabel="Re s [rad/s]", ylabel="Im s [rad/s]")


def _draw_curves(axes: Axes, spec: DStability) -> None:
    """Draw the boundaries in the plane of the gains, and the published gains."""
    for curve in boundary_curves(paper_eq19(), spec, _K_D_RAD_S_M):
        label = f"{curve.bound}, {curve.kind} root"
        axes.plot(*curve.gains.T, **_LINES[curve.kind, curve.bound], label=label)
    axes.plot(*_PUBLISHED_GAINS[0], "o", color="black", label="published gains")
    axes.set(xlabel="K_p [rad/m]", ylabel="K_d [rad s/m]", xlim=_K_P_RAD_M, ylim=_K_D_RAD_S_M)


def _verdict(agrees: bool) -> Verdict:
    return Verdict.WITH_CORRECTION if agrees else Verdict.NOT_REPRODUCIBLE
