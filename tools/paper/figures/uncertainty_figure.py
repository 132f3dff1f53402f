"""Figure 9: the small gain condition (23) of the DOB, and beside it what is exact.

    |Q(jω)| < 1/|Δ_m(jω)| for all ω,   Δ_m = (G e^(-sT) - G_n)/G_n

The paper has T = 0. The exact answer is the count of roots of (21), delay included.
"""

import numpy as np
from matplotlib.figure import Figure

from ....closed_loop.parameter_space.root_count import on_axis
from ....closed_loop.parameter_space.uncertainty import paper_box
from ....controller.filters.continuous_filters import q_order_2, q_type_2
from ....controller.filters.nominal_model import paper_eq19, steer_to_lateral_error
from ....controller.filters.transfer_function import TransferFunction
from ..continuous_loop import closed_loop_roots, dob_alone
from ..corners import CORNERS, corner_labels, corner_plants
from ..result import Comparison, Picture, Reproduction, Verdict, unpublished
from ..small_gain import (
    Interval,
    QFamily,
    accepted_cutoffs,
    condition_23,
    cutoffs_that_meet_23,
    largest_uncertainty,
    multiplicative_uncertainty,
)

CUTOFF_RAD_S = 5.0
"""ω_c of section VI.B.1."""
DELAY_S = 0.08
"""T of section IV."""
_OMEGA_RAD_S = (1e-2, 1e3)
_OMEGAS = 2001
_EXACT_POINTS = 50


def figure_9() -> Reproduction:
    """Return |Q| against 1/|Δ_m| at the vertices, the largest cutoff, and the exact answer."""
    vehicle = steer_to_lateral_error(paper_box().nominal)
    return Reproduction(
        key="figure_09",
        title="Figure 9: |Q| against 1/|Δ_m|",
        caption="Q of (20) with ω_c = 5 rad/s; Δ_m = (G - G_n)/G_n at the four vertices of Figure"
        " 2, C_r = 500,000 N/rad and l_s = 2 m; G_n of (19), and of the vehicle.",
        pictures=(
            _uncertainty_picture("figure_09", paper_eq19(), "G_n of (19)"),
            _uncertainty_picture("figure_09_vehicle_model", vehicle, "G_n of Table I, 5 km/h"),
            _uncertainty_picture("figure_09_with_delay", paper_eq19(), "G_n of (19)", DELAY_S),
        ),
        comparisons=(
            *_condition_comparisons(paper_eq19(), "G_n of (19)"),
            *_condition_comparisons(vehicle, "G_n of Table I"),
        ),
        verdict=Verdict.WITH_CORRECTION,
        why="With C_r and l_s corrected the condition holds at ω_c = 5 rad/s. But it does not limit"
        " ω_c: |Δ_m| < 1 at all ω, so every cutoff of (20) meets it. The type-2 Q, which exceeds"
        " 1, fails it with the vehicle's own model at small cutoffs. What limits ω_c is the"
        " delay, which (23) leaves out: with it in Δ_m there is a bound, and the exact bound of"
        " the loop (21) is a little larger.",
    )


def exact_cutoffs(family: QFamily, model: TransferFunction, delay_s: float) -> tuple[Interval, ...]:
    """Return the cutoffs at which the loop (21) has no root to the right, at all four vertices."""
    plants = corner_plants()

    def stable(cutoff_rad_s: float) -> bool:
        law = dob_alone(family(cutoff_rad_s), model)
        return all(closed_loop_roots(law, plant, delay_s).right == 0 for plant in plants)

    return accepted_cutoffs(stable, _EXACT_POINTS)


def _condition_comparisons(model: TransferFunction, name: str) -> tuple[Comparison, ...]:
    plants = corner_plants()
    q = q_order_2(CUTOFF_RAD_S)
    ratios = [condition_23(q, largest_uncertainty((plant,), model)).size for plant in plants]
    margins = ", ".join(
        f"{corner} {-20.0 * np.log10(ratio):.1f}"
        for corner, ratio in zip(CORNERS, ratios, strict=True)
    )
    rows = [
        Comparison(
            f"smallest 1/|Q Δ_m| at ω_c = {CUTOFF_RAD_S:g} rad/s, {name}",
            "above 0 dB" if name == "G_n of (19)" else "",
            f"{margins} dB",
            max(ratios) < 1.0 if name == "G_n of (19)" else None,
        )
    ]
    for delay_s in (0.0, DELAY_S):
        at_vertices = largest_uncertainty(plants, model, delay_s)
        for family, kind in ((q_order_2, "(20)"), (q_type_2, "type 2")):
            met = cutoffs_that_meet_23(family, at_vertices)
            exact = exact_cutoffs(family, model, delay_s)
            what = f"ω_c that meet (23), Q of {kind}, {name}, T = {1e3 * delay_s:.0f} ms"
            rows.append(unpublished(what, f"{_ranges(met)}; loop (21) stable: {_ranges(exact)}"))
    return tuple(rows)


def _ranges(ranges: tuple[Interval, ...]) -> str:
    texts = []
    for minimum, maximum in ranges:
        if np.isinf(maximum):
            texts.append("all" if minimum == 0.0 else f"above {minimum:.3g} rad/s")
        elif minimum == 0.0:
            texts.append(f"up to {maximum:.4g} rad/s")
        else:
            texts.append(f"{minimum:.3g} to {maximum:.4g} rad/s")
    return " and ".join(texts) or "none"


def _uncertainty_picture(
    name: str, model: TransferFunction, model_name: str, delay_s: float = 0.0
) -> Picture:
    omega_rad_s = np.geomspace(*_OMEGA_RAD_S, _OMEGAS)
    plants = corner_plants()
    columns = {"omega_rad_s": omega_rad_s}
    figure = Figure(figsize=(8.0, 4.8))
    axes = figure.subplots()
    for corner, label, plant in zip(CORNERS, corner_labels(), plants, strict=True):
        uncertainty = np.abs(multiplicative_uncertainty(plant, model, omega_rad_s, delay_s))
        inverse_db = -20.0 * np.log10(uncertainty)
        columns[f"inverse_uncertainty_{corner}_db"] = inverse_db
        axes.semilogx(omega_rad_s, inverse_db, label=f"1/|Δ_m|, {label}")
    cutoffs = {f"{CUTOFF_RAD_S:g} rad/s": (CUTOFF_RAD_S, "-")}
    met = cutoffs_that_meet_23(q_order_2, largest_uncertainty(plants, model, delay_s))
    largest_rad_s = met[-1].maximum_rad_s
    if np.isfinite(largest_rad_s):
        cutoffs[f"{largest_rad_s:.1f} rad/s, the largest"] = (largest_rad_s, ":")
    for index, (label, (cutoff_rad_s, line)) in enumerate(cutoffs.items()):
        q_db = 20.0 * np.log10(np.abs(q_order_2(cutoff_rad_s).response(on_axis(omega_rad_s))))
        columns["q_db" if index == 0 else "q_largest_db"] = q_db
        axes.semilogx(omega_rad_s, q_db, line, color="black", lw=2.0, label=f"|Q|, ω_c = {label}")
    axes.set(xlabel="ω [rad/s]", ylabel="size [dB]", ylim=(-40.0, 40.0))
    delay = f", T = {1e3 * delay_s:.0f} ms in the plant" if delay_s else ""
    axes.set_title(f"|Q| against 1/|Δ_m|, {model_name}{delay}")
    axes.margins(x=0.0)
    axes.legend(loc="lower left", fontsize=9)
    return Picture(name, figure, columns)
