"""Figures 9 and 12 of SAE 2018-01-1086: the small gain conditions of the DOB and of the CDOB.

    Figure 9     |Q| < 1/|Δ_m| for all ω,              Δ_m = (G - G_n)/G_n       (23)
    Figure 12    |L_n/(1 + L_n)| < 1/|Δ_m| for all ω,  Δ_m = e^(-jωT) - 1        (25)

The conditions are only sufficient; the roots of the loop decide: those of the law as it runs at
1 kHz.
"""

from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from ....closed_loop.reports.law_colours import COLOURS
from ....closed_loop.reports.plot_style import law_styles
from ....controller.analysis.sampled_loop import SampledLoop
from ....controller.filters.continuous_filters import q_order_2
from ....controller.filters.nominal_model import paper_eq19
from ....controller.laws.law_from_settings import design_law
from ....controller.settings import ControllerSettings
from ....runtime.array_types import FloatArray
from ....runtime.node import NS_PER_S
from ..corners import CORNERS, corner_labels, corner_plants, published_law
from ..result import Comparison, Picture, Reproduction, Verdict
from ..small_gain import (
    cdob_nominal_loop,
    cdob_parts,
    cdob_small_gain,
    condition_23,
    delay_uncertainty,
    multiplicative_uncertainty,
    on_axis,
)

CUTOFF_RAD_S = 5.0
"""ω_c of the DOB, section VI.B.1."""
DELAY_S = 0.08
"""T of section IV."""
FILTER_RAD_S = 20.0
"""N of the derivative filter that stands for the one the text does not mention."""
_OMEGA_RAD_S = np.geomspace(1e-2, 1e3, 5001)
_AT_ONE = 1e-4
"""Poles so near to z = 1 are the two integrators that the CDOB cancels, moved by rounding."""


def figure_9() -> Reproduction:
    """Return |Q| against 1/|Δ_m| at the vertices, and the cutoffs that meet the condition."""
    q, plants = q_order_2(CUTOFF_RAD_S), corner_plants()
    ratios = [condition_23(q, plant, paper_eq19()) for plant in plants]
    margins = ", ".join(
        f"{corner} {-20.0 * np.log10(ratio.size):.1f}"
        for corner, ratio in zip(CORNERS, ratios, strict=True)
    )
    return Reproduction(
        key="figure_09",
        title="|Q| against 1/|Δ_m|",
        caption="Q of (20) with ω_c = 5 rad/s; Δ_m = (G - G_n)/G_n at the four vertices of Figure"
        " 2, C_r = 500,000 N/rad and l_s = 2 m; G_n of (19).",
        pictures=(_uncertainty_picture(),),
        comparisons=(
            Comparison(
                f"smallest 1/|Q Δ_m| at ω_c = {CUTOFF_RAD_S:g} rad/s",
                "above 0 dB",
                f"{margins} dB",
                max(ratio.size for ratio in ratios) < 1.0,
            ),
        ),
        verdict=Verdict.WITH_CORRECTION,
        why="With C_r and l_s corrected the condition holds at ω_c = 5 rad/s. But it does not limit"
        " ω_c: |Δ_m| < 1 at all ω, so every cutoff of (20) meets it.",
    )


def _uncertainty_picture() -> Picture:
    figure = Figure(figsize=(8.0, 4.8))
    axes = figure.subplots()
    for label, plant in zip(corner_labels(), corner_plants(), strict=True):
        uncertainty = np.abs(multiplicative_uncertainty(plant, paper_eq19(), _OMEGA_RAD_S))
        inverse_db = -20.0 * np.log10(uncertainty)
        axes.semilogx(_OMEGA_RAD_S, inverse_db, label=f"1/|Δ_m|, {label}")
    q_db = 20.0 * np.log10(np.abs(q_order_2(CUTOFF_RAD_S).response(on_axis(_OMEGA_RAD_S))))
    label = f"|Q|, ω_c = {CUTOFF_RAD_S:g} rad/s"
    axes.semilogx(_OMEGA_RAD_S, q_db, color="black", lw=2.0, label=label)
    axes.set(xlabel="ω [rad/s]", ylabel="size [dB]", ylim=(-40.0, 40.0))
    axes.set_title("|Q| against 1/|Δ_m|, G_n of (19)")
    axes.margins(x=0.0)
    axes.legend(loc="lower left", fontsize=9)
    return Picture("figure_09", figure)


class NetworkVerdict(NamedTuple):
    """What is known of a CDOB loop at the delay of section IV.

    ``ratio``        largest |L_n/(1 + L_n) Δ_m|; below 1 proves stability
    ``omega_rad_s``  where it is
    ``outside``      roots of the loop outside the unit circle
    ``at_one``       its roots at z = 1
    """

    ratio: float
    omega_rad_s: float
    outside: int
    at_one: int


def figure_12() -> Reproduction:
    """Return |L_n/(1 + L_n)| against 1/|Δ_m|, ideal and filtered derivative, and what is exact."""
    ideal = published_law("pd_cdob")
    derivative = f"pd.derivative_filter_rad_s={FILTER_RAD_S}"
    filtered = published_law("pd_cdob", derivative)
    return Reproduction(
        key="figure_12",
        title="|L_n/(1 + L_n)| against 1/|Δ_m|",
        caption="PD with K_p = 1.0596, K_d = 0.939; G = G_n of (19); Q of (20), ω_c = 200 rad/s;"
        " T = 80 ms; (26) without its second e^(-Ts).",
        pictures=(
            _network_picture("figure_12", ideal, "ideal derivative"),
            _network_picture(
                "figure_12_filtered", filtered, f"derivative filtered at {FILTER_RAD_S:g} rad/s"
            ),
        ),
        comparisons=(
            *_network_comparisons(ideal, "ideal derivative"),
            Comparison(
                "lowest ω where the curves meet, ideal derivative",
                "no intersection",
                f"{first_intersection_rad_s(ideal):.1f} rad/s",
                False,
            ),
            *_network_comparisons(filtered, f"N = {FILTER_RAD_S:g} rad/s"),
        ),
        verdict=Verdict.WITH_CORRECTION,
        why="With the ideal derivative of the text the curves do intersect, above 100 rad/s, where"
        " the printed picture may have ended, and the loop really is unstable. With the derivative"
        f" filtered at {FILTER_RAD_S:g} rad/s the statement holds. Two things (25) does not say:"
        " it is sufficient only, and may fail where the loop is stable; and it sees"
        " y/r, not the two roots at z = 1 with which the published CDOB drifts off the path.",
    )


def network_verdict(settings: ControllerSettings) -> NetworkVerdict:
    """Return the results of condition and roots for a CDOB around its own nominal model."""
    parts = cdob_parts(settings)
    ratio, omega_rad_s = cdob_small_gain(parts, DELAY_S)
    loop = SampledLoop(design_law(settings), parts.model, settings.period_ns)
    poles = loop.closed_loop_poles(round(DELAY_S * NS_PER_S))
    is_at_one = np.abs(poles - 1.0) < _AT_ONE
    outside = (np.abs(poles) > 1.0) & ~is_at_one
    return NetworkVerdict(ratio, omega_rad_s, int(outside.sum()), int(is_at_one.sum()))


def first_intersection_rad_s(settings: ControllerSettings) -> float:
    """Return the lowest ω at which (25) fails [rad/s]; inf where it is met."""
    ratio = _closed_nominal(settings) * np.abs(delay_uncertainty(_OMEGA_RAD_S, DELAY_S))
    return float(min(_OMEGA_RAD_S[ratio >= 1.0], default=np.inf))


def _closed_nominal(settings: ControllerSettings) -> FloatArray:
    nominal = cdob_nominal_loop(cdob_parts(settings), _OMEGA_RAD_S)
    return np.asarray(np.abs(nominal / (1.0 + nominal)), np.float64)


def _network_comparisons(settings: ControllerSettings, name: str) -> tuple[Comparison, ...]:
    """Return condition and exact result at 80 ms."""
    verdict = network_verdict(settings)
    at_delay = f"T = {1e3 * DELAY_S:.0f} ms, {name}"
    return (
        Comparison(
            f"largest |L_n/(1 + L_n) Δ_m|, {at_delay}",
            "below 1",
            f"{verdict.ratio:.3f} at {verdict.omega_rad_s:.0f} rad/s",
            verdict.ratio < 1.0,
        ),
        Comparison(
            f"unstable roots of the law sampled at 1 kHz, {at_delay}",
            "stable",
            f"{verdict.outside}; besides, {verdict.at_one} at z = 1",
            verdict.outside == 0,
        ),
    )


def _network_picture(name: str, settings: ControllerSettings, subtitle: str) -> Picture:
    closed_db = 20.0 * np.log10(_closed_nominal(settings))
    inverse_db = -20.0 * np.log10(np.abs(delay_uncertainty(_OMEGA_RAD_S, DELAY_S)))
    figure = Figure(figsize=(8.0, 4.8))
    axes = figure.subplots()
    (style,) = law_styles(["pd_cdob"])
    axes.semilogx(_OMEGA_RAD_S, closed_db, label="|L_n/(1 + L_n)|", **style)
    axes.semilogx(_OMEGA_RAD_S, inverse_db, color="0.3", label="1/|Δ_m|")
    above = closed_db >= inverse_db
    axes.fill_between(
        _OMEGA_RAD_S, closed_db, inverse_db, where=above, color=COLOURS[3], alpha=0.8, lw=0.0
    )
    axes.set(xlabel="ω [rad/s]", ylabel="size [dB]", xlim=(0.1, None), ylim=(-60.0, 40.0))
    axes.set_title(f"Small gain condition of the CDOB, {subtitle}")
    axes.legend(loc="center left")
    outside = network_verdict(settings).outside
    condition = "not met (shaded)" if np.any(above) else "met"
    exact = f"{outside} unstable roots" if outside else "y/r is stable"
    axes.text(
        0.62, 0.05, f"condition {condition}\nexact: {exact}", transform=axes.transAxes, fontsize=10
    )
    return Picture(name, figure)
