"""Figure 12 of SAE 2018-01-1086: the small gain condition (25) of the CDOB, and what is exact.

    |L_n/(1 + L_n)| < 1/|Δ_m| for all ω,   Δ_m = e^(-jωT) - 1

The condition is only sufficient; the roots of the loop decide. They are counted with the exact
delay in continuous time, and computed for the law as it runs at 1 kHz.
"""

from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from ....closed_loop.reports.plot_style import COLOURS
from ....controller.analysis.sampled_loop import SampledLoop
from ....controller.filters.nominal_model import paper_eq19
from ....controller.laws.law_from_settings import design_law
from ....controller.settings import ControllerSettings
from ....runtime.array_types import FloatArray
from ....runtime.node import NS_PER_S
from ..continuous_loop import cdob_parts, closed_loop_roots, continuous_law
from ..corners import published_law
from ..result import Comparison, Picture, Reproduction, Verdict
from ..small_gain import cdob_nominal_loop, cdob_small_gain, delay_uncertainty

DELAY_S = 0.08
"""T of section IV."""
FILTER_RAD_S = 20.0
"""N of the derivative filter that stands for the one the text does not mention."""
_UNIT_CIRCLE = 1e-5
"""Poles this near to |z| = 1 are the two integrators that the CDOB cancels, moved by rounding."""
_OMEGA_RAD_S = (1e-1, 1e3)
_OMEGAS = 4001


class NetworkVerdict(NamedTuple):
    """What is known of a CDOB loop at one delay.

    ``ratio``          largest |L_n/(1 + L_n) Δ_m|; below 1 proves stability
    ``omega_rad_s``    where it is
    ``printed_ratio``  the same with the e^(-Ts) that (26) is printed with
    ``right``          roots of the continuous loop in the right half-plane
    ``at_origin``      its roots at s = 0
    ``outside``        poles of the sampled loop outside the unit circle
    """

    ratio: float
    omega_rad_s: float
    printed_ratio: float
    right: int
    at_origin: int
    outside: int


def figure_12() -> Reproduction:
    """Return |L_n/(1 + L_n)| against 1/|Δ_m|, ideal and filtered derivative, and what is exact."""
    ideal = published_law("pd_cdob")
    derivative = f"pd.derivative_filter_rad_s={FILTER_RAD_S}"
    filtered = published_law("pd_cdob", derivative)
    return Reproduction(
        key="figure_12",
        title="Figure 12: |L_n/(1 + L_n)| against 1/|Δ_m|",
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
                f"{first_intersection_rad_s(ideal, DELAY_S):.1f} rad/s",
                False,
            ),
            *_network_comparisons(filtered, f"N = {FILTER_RAD_S:g} rad/s"),
        ),
        verdict=Verdict.WITH_CORRECTION,
        why="With the ideal derivative of the text the curves do intersect, above 100 rad/s, where"
        " the printed picture may have ended, and the loop really is unstable. With the derivative"
        f" filtered at {FILTER_RAD_S:g} rad/s the statement holds. Two things (25) does not say:"
        " it is sufficient only, and may fail where the loop is stable; and it sees"
        " y/r, not the two roots at s = 0 with which the published CDOB drifts off the path.",
    )


def network_verdict(settings: ControllerSettings, delay_s: float) -> NetworkVerdict:
    """Return the results of condition and roots for a CDOB around its own nominal model."""
    parts = cdob_parts(settings)
    ratio, omega_rad_s = cdob_small_gain(parts, delay_s)
    roots = closed_loop_roots(continuous_law(settings), parts.model, delay_s)
    loop = SampledLoop(design_law(settings), parts.model, settings.period_ns)
    poles = loop.closed_loop_poles(round(delay_s * NS_PER_S))
    return NetworkVerdict(
        ratio=ratio,
        omega_rad_s=omega_rad_s,
        printed_ratio=cdob_small_gain(parts, delay_s, as_printed=True).size,
        right=roots.right,
        at_origin=roots.at_origin,
        outside=int(np.count_nonzero(np.abs(poles) > 1.0 + _UNIT_CIRCLE)),
    )


def first_intersection_rad_s(settings: ControllerSettings, delay_s: float) -> float:
    """Return the lowest ω at which (25) fails [rad/s]; inf where it is met."""
    omega_rad_s = np.geomspace(*_OMEGA_RAD_S, _OMEGAS)
    ratio = _closed_nominal(settings, omega_rad_s) * np.abs(delay_uncertainty(omega_rad_s, delay_s))
    return float(min(omega_rad_s[ratio >= 1.0], default=np.inf))


def _closed_nominal(settings: ControllerSettings, omega_rad_s: FloatArray) -> FloatArray:
    nominal = cdob_nominal_loop(cdob_parts(settings), omega_rad_s)
    return np.asarray(np.abs(nominal / (1.0 + nominal)), np.float64)


def _network_comparisons(settings: ControllerSettings, name: str) -> tuple[Comparison, ...]:
    """Return condition and exact result at 80 ms."""
    verdict = network_verdict(settings, DELAY_S)
    at_delay = f"T = {1e3 * DELAY_S:.0f} ms, {name}"
    return (
        Comparison(
            f"largest |L_n/(1 + L_n) Δ_m|, {at_delay}",
            "below 1",
            f"{verdict.ratio:.3f} at {verdict.omega_rad_s:.0f} rad/s"
            f" ((26) as printed: {verdict.printed_ratio:.3g})",
            verdict.ratio < 1.0,
        ),
        Comparison(
            f"unstable roots of y/r with exact delay, {at_delay}",
            "stable",
            f"{verdict.right} (law sampled at {settings.rate_hz:.0f} Hz: {verdict.outside});"
            f" besides, {verdict.at_origin} at s = 0",
            verdict.right == 0,
        ),
    )


def _network_picture(name: str, settings: ControllerSettings, subtitle: str) -> Picture:
    omega_rad_s = np.geomspace(*_OMEGA_RAD_S, _OMEGAS)
    closed_db = 20.0 * np.log10(_closed_nominal(settings, omega_rad_s))
    inverse_db = -20.0 * np.log10(np.abs(delay_uncertainty(omega_rad_s, DELAY_S)))
    figure = Figure(figsize=(8.0, 4.8))
    axes = figure.subplots()
    axes.semilogx(omega_rad_s, closed_db, color=COLOURS[1], label="|L_n/(1 + L_n)|")
    axes.semilogx(omega_rad_s, inverse_db, color=COLOURS[0], label="1/|Δ_m|")
    above = closed_db >= inverse_db
    axes.fill_between(
        omega_rad_s, closed_db, inverse_db, where=above, color=COLOURS[3], alpha=0.8, lw=0.0
    )
    axes.set(xlabel="ω [rad/s]", ylabel="size [dB]", ylim=(-60.0, 40.0))
    axes.set_title(f"Small gain condition of the CDOB, {subtitle}")
    axes.margins(x=0.0)
    axes.legend(loc="center left")
    roots = closed_loop_roots(continuous_law(settings), paper_eq19(), DELAY_S)
    condition = "not met (shaded)" if np.any(above) else "met"
    exact = f"{roots.right} unstable roots" if roots.right else "y/r is stable"
    axes.text(
        0.62, 0.05, f"condition {condition}\nexact: {exact}", transform=axes.transAxes, fontsize=10
    )
    columns = {"omega_rad_s": omega_rad_s, "nominal_closed_loop_db": closed_db}
    return Picture(name, figure, columns | {"inverse_uncertainty_db": inverse_db})
