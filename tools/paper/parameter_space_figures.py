"""Figures 7 and 8: D-stability boundaries and region of (K_p, K_d), and a figure beyond the paper.

The paper designs for the continuous nominal loop alone. Beyond it: all four corners of the
uncertainty box at once, and the loop as it runs, sampled, held and delayed.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...closed_loop.parameter_space.d_stability import judge, paper_d_stability
from ...closed_loop.parameter_space.drawing import GAIN_LABELS, draw_curves, draw_gamma, fill_region
from ...closed_loop.parameter_space.gain_boundaries import Bound, BoundaryCurve, RootKind, Window
from ...closed_loop.parameter_space.gain_loops import ContinuousGainLoop, SampledGainLoop
from ...closed_loop.parameter_space.gain_regions import GainRegion, d_stable_region
from ...closed_loop.reports.plot_style import COLOURS
from ...controller.filters.nominal_model import paper_eq19
from ...runtime.array_types import ComplexArray, FloatArray
from ...runtime.node import NS_PER_MS
from .corners import corner_labels, corner_plants
from .result import Comparison, Picture, Reproduction, Verdict, unpublished

# ruff: noqa: RUF001  # σ is the paper's symbol


PUBLISHED_K_P_RAD_M = 1.0596
PUBLISHED_K_D_RAD_S_M = 0.939
WINDOW = Window(-0.5, 3.5, -0.6, 2.4)
PERIOD_NS = 10 * NS_PER_MS
DELAYS_MS = (0, 80, 160)
FILTERS_RAD_S = (None, 20.0, 5.0)

_PUBLISHED_GAINS = np.array([[PUBLISHED_K_P_RAD_M, PUBLISHED_K_D_RAD_S_M]])
_READING = (
    "R is read as bounding the two roots nearest the origin. No gains at all bring all four within"
    " 1.3 rad/s: their sum, -(459.2 + 227.6 K_d) rad/s, alone asks for K_d near -2. Every root has"
    " to be left of -σ, every root within R inside the cone. The boundaries are found by crossing"
    " ∂Γ, not by gridding."
)


def figure_7() -> Reproduction:
    """Return ∂Γ with the roots of the published loop, and its image in the plane of the gains."""
    spec, loop = paper_d_stability(), ContinuousGainLoop(paper_eq19())
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
        (Picture("figure_07", figure, curve_columns(region.curves)),),
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
    spec, loop = paper_d_stability(), ContinuousGainLoop(paper_eq19())
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
        (Picture("figure_08", figure, region_columns([region])),),
        (
            Comparison("published gains", "in the region", _inside(inside), inside),
            *_margin_comparisons(region),
        ),
        _verdict(inside),
        _READING,
    )


def figure_8_beyond() -> Reproduction:
    """Return the regions of the four corners, and of the sampled loop with delay."""
    spec = paper_d_stability()
    loops = [ContinuousGainLoop(plant) for plant in corner_plants()]
    names = (label.partition(": ")[2] for label in corner_labels())
    each = {
        name: d_stable_region([loop], spec, WINDOW) for name, loop in zip(names, loops, strict=True)
    }
    regions = [d_stable_region(loops, spec, WINDOW)]
    figure = Figure(figsize=(11.0, 8.4))
    panels = figure.subplots(2, 2, sharex=True, sharey=True).ravel()
    _draw_corners(panels[0], regions[0], each)
    comparisons = [_judged(name, region) for name, region in each.items()]
    for axes, filter_rad_s in zip(panels[1:], FILTERS_RAD_S, strict=True):
        derivative = "ideal derivative" if filter_rad_s is None else f"N = {filter_rad_s:g} rad/s"
        axes.set_title(f"sampled at 100 Hz, plant (19), {derivative}", fontsize=10)
        for delay_ms, shade in zip(DELAYS_MS, (0.15, 0.3, 0.6), strict=True):
            loop = SampledGainLoop(paper_eq19(), PERIOD_NS, delay_ms * NS_PER_MS, filter_rad_s)
            region = d_stable_region([loop], spec, WINDOW)
            regions.append(region)
            fill_region(axes, region, f"{delay_ms} ms: area {region.polygon.area:.2f}", shade)
            comparisons.append(_judged(f"sampled, {derivative}, {delay_ms} ms", region))
        _draw_published(axes)
    for axes in panels:
        axes.legend(loc="lower right", fontsize=9)
        axes.set(xlim=WINDOW[:2], ylim=WINDOW[2:], **GAIN_LABELS)
        axes.label_outer()
    return Reproduction(
        "figure_08_beyond",
        "Solution region: all corners, and the sampled loop with delay",
        "As Figure 8. Corners: continuous, V = 4 and 7 km/h, virtual mass 1600 and 5000 kg,"
        " C_r = 500,000 N/rad. Sampled: hold, delay and controller as they run, exact. Areas within"
        " the picture [rad² s/m²].",
        (Picture("figure_08_beyond", figure, region_columns(regions)),),
        tuple(comparisons),
        Verdict.BEYOND,
        "Not in the paper: its region is that of one continuous loop without delay. The robustness"
        " over the corners that it claims is there. A delay of the network takes the region from"
        " above, at K_d, and the published gains leave it unless the derivative is filtered (N).",
    )


def _roots(loop: ContinuousGainLoop) -> ComplexArray:
    """Return the roots at the published gains, nearest the origin first, Im > 0 before Im < 0."""
    roots_rad_s = loop.roots(_PUBLISHED_GAINS)[0]
    order = np.lexsort((-roots_rad_s.imag, np.round(np.abs(roots_rad_s), 9)))
    return np.asarray(roots_rad_s[order])


def _draw_published(axes: Axes) -> None:
    axes.plot(*_PUBLISHED_GAINS[0], "o", color="black", label="published gains")


def _draw_corners(axes: Axes, common: GainRegion, each: Mapping[str, GainRegion]) -> None:
    """Fill the region of all corners, and draw the edge of each corner's own."""
    fill_region(axes, common, f"all four: area {common.polygon.area:.2f}", 0.3)
    for index, ((name, region), colour) in enumerate(zip(each.items(), COLOURS, strict=False)):
        style = {"ls": "--", "lw": 2.0} if index % 2 else {"lw": 1.2}  # the two are almost equal
        axes.plot(*region.polygon.exterior.xy, color=colour, label=name, **style)
    _draw_published(axes)
    axes.set_title("continuous, every corner of the uncertainty box", fontsize=10)


def _judged(name: str, region: GainRegion) -> Comparison:
    inside = region.contains(PUBLISHED_K_P_RAD_M, PUBLISHED_K_D_RAD_S_M)
    distance = abs(region.relative_distance(PUBLISHED_K_P_RAD_M, PUBLISHED_K_D_RAD_S_M))
    text = f"{_inside(inside)}, {distance:.0%} of the gains from the edge"
    return unpublished(f"published gains: {name}", text)


def _margin_comparisons(region: GainRegion) -> tuple[Comparison, ...]:
    return tuple(
        unpublished(
            f"distance to the boundary {margin.bound}, {margin.kind} root",
            f"{margin.relative:.0%} of the gains",
        )
        for margin in region.margins(PUBLISHED_K_P_RAD_M, PUBLISHED_K_D_RAD_S_M)
    )


def _inside(inside: bool) -> str:
    return "inside" if inside else "outside"


def _verdict(agrees: bool) -> Verdict:
    return Verdict.WITH_CORRECTION if agrees else Verdict.NOT_REPRODUCIBLE


def curve_columns(curves: Sequence[BoundaryCurve]) -> dict[str, FloatArray]:
    """Return every boundary, point by point; bound and root count the legend's from 1."""
    bounds, kinds = list(Bound), list(RootKind)
    labels = [(i, bounds.index(c.bound) + 1, kinds.index(c.kind) + 1) for i, c in enumerate(curves)]
    each = np.repeat(np.array(labels, dtype=np.float64), [len(c.gains) for c in curves], axis=0)
    gains = np.concatenate([curve.gains for curve in curves])
    s_rad_s = np.concatenate([curve.s_rad_s for curve in curves])
    return {
        "curve": each[:, 0],
        "bound_sigma_theta_r": each[:, 1],
        "root_complex_real_infinite": each[:, 2],
        "k_p_rad_m": gains[:, 0],
        "k_d_rad_s_m": gains[:, 1],
        "s_real_rad_s": s_rad_s.real,
        "s_imag_rad_s": s_rad_s.imag,
    }


def region_columns(regions: Sequence[GainRegion]) -> dict[str, FloatArray]:
    """Return the edge of every region, ring by ring."""
    rings = [
        (index, np.asarray(ring.coords))
        for index, region in enumerate(regions)
        for part in shapely.get_parts(region.polygon)
        for ring in (part.exterior, *part.interiors)
    ]
    gains = np.concatenate([ring for _, ring in rings])
    return {
        "region": np.concatenate([np.full(len(ring), float(index)) for index, ring in rings]),
        "ring": np.concatenate([np.full(len(ring), float(i)) for i, (_, ring) in enumerate(rings)]),
        "k_p_rad_m": gains[:, 0],
        "k_d_rad_s_m": gains[:, 1],
    }
