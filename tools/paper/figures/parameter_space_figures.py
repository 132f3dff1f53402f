"""Figures 7 and 8: D-stability boundaries and region of (K_p, K_d).

The paper designs for the continuous nominal loop alone.
"""

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ....closed_loop.parameter_space.d_stability import judge, paper_d_stability
from ....closed_loop.parameter_space.gain_boundaries import Window
from ....closed_loop.parameter_space.gain_loop import GainLoop
from ....closed_loop.parameter_space.gain_regions import GainRegion, d_stable_region
from ....closed_loop.parameter_space.region_pictures import (
    GAIN_LABELS,
    draw_curves,
    draw_gamma,
    fill_region,
)
from ....controller.filters.nominal_model import paper_eq19
from ....runtime.array_types import ComplexArray
from ..result import Comparison, Picture, Reproduction, Verdict, unpublished

# ruff: noqa: RUF001  # σ is the paper's symbol


PUBLISHED_K_P_RAD_M = 1.0596
PUBLISHED_K_D_RAD_S_M = 0.939
WINDOW = Window(-0.5, 3.5, -0.6, 2.4)

_PUBLISHED_GAINS = np.array([[PUBLISHED_K_P_RAD_M, PUBLISHED_K_D_RAD_S_M]])
_READING = (
    "R is read as bounding the two roots nearest the origin. No gains at all bring all four within"
    " 1.3 rad/s: their sum, -(459.2 + 227.6 K_d) rad/s, alone asks for K_d near -2. Every root has"
    " to be left of -σ, every root within R inside the cone. The boundaries are found by crossing"
    " ∂Γ, not by gridding."
)


def figure_7() -> Reproduction:
    """Return ∂Γ with the roots of the published loop, and its image in the plane of the gains."""
    spec, loop = paper_d_stability(), GainLoop(paper_eq19())
    region = d_stable_region([loop], spec, WINDOW)
    roots_rad_s = _roots(loop)
    figure = Figure(figsize=(10.5, 5.6))
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.35))
    draw_gamma(left, spec)
    near = roots_rad_s[np.abs(roots_rad_s) < 3.0]
    left.plot(near.real, near.imag, "x", color="black", ms=8, mew=2, label="published loop")
    left.legend(loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=2)
    left.set_title("∂Γ in the plane of the roots")
    draw_curves(right, region.curves)
    _draw_published(right)
    right.set(xlim=WINDOW[:2], ylim=WINDOW[2:], **GAIN_LABELS)
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
            unpublished(
                "dominant roots at the published gains",
                f"{pair.real:.4f} ± {abs(pair.imag):.4f}j rad/s",
            ),
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
            unpublished("infinite root boundary", "none: P C is strictly proper"),
        ),
        _verdict(bool(judged.satisfied)),
        _READING,
    )


def figure_8() -> Reproduction:
    """Return the gains for which the nominal loop is D-stable, and where the published ones are."""
    spec, loop = paper_d_stability(), GainLoop(paper_eq19())
    region = d_stable_region([loop], spec, WINDOW)
    inside = region.contains(PUBLISHED_K_P_RAD_M, PUBLISHED_K_D_RAD_S_M)
    figure = Figure(figsize=(8.5, 5.4))
    axes = figure.subplots()
    fill_region(axes, region, "D-stable")
    draw_curves(axes, region.curves)
    _draw_published(axes)
    axes.set(xlim=WINDOW[:2], ylim=WINDOW[2:], **GAIN_LABELS)
    axes.set_title("D-stable gains of the nominal loop")
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
            *_margin_comparisons(region),
        ),
        _verdict(inside),
        _READING,
    )


def _roots(loop: GainLoop) -> ComplexArray:
    """Return the roots at the published gains, nearest the origin first, Im > 0 before Im < 0."""
    roots_rad_s = loop.roots(_PUBLISHED_GAINS)[0]
    order = np.lexsort((-roots_rad_s.imag, np.round(np.abs(roots_rad_s), 9)))
    return np.asarray(roots_rad_s[order])


def _draw_published(axes: Axes) -> None:
    axes.plot(*_PUBLISHED_GAINS[0], "o", color="black", label="published gains")


def _margin_comparisons(region: GainRegion) -> tuple[Comparison, ...]:
    return tuple(
        unpublished(
            f"distance to the boundary {margin.bound}, {margin.kind} root",
            f"{margin.relative:.0%} of the gains",
        )
        for margin in region.margins(PUBLISHED_K_P_RAD_M, PUBLISHED_K_D_RAD_S_M)
    )


def _verdict(agrees: bool) -> Verdict:
    return Verdict.WITH_CORRECTION if agrees else Verdict.NOT_REPRODUCIBLE
