"""Table II: RMS tracking errors of PD and PD+DOB in the four corners.

Values are compared as printed, with four digits. The PD row is reproduced within 0.0002 m once C_r
has its zero back. The PD+DOB row is not: (11) with Q of (20) at 5 rad/s leaves a thirtieth of the
error, the table only a good half. A cut-off of 0.065 rad/s alone comes within 0.0018 m.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from ...closed_loop.pair.pair_result import rms
from ...closed_loop.reports.law_colours import COLOURS
from ...controller.settings import controller_preset
from . import published
from .result import CLAIM, NUMBER, Comparison, Picture, Reproduction, verdict_of
from .simulation import History, paper_plant, simulate

DURATION_S = 200.0
CORRECTED, PRINTED = 500e3, published.REAR_CORNERING_STIFFNESS_N_RAD
FITTED_CUTOFF_RAD_S = 0.065
"""Of the DOB, with which the PD+DOB row nearly comes out; the text has 5 rad/s."""
TOLERANCE_M = 2e-4
"""Twice the last printed digit: the axes of the ellipse are fitted, and rounded."""

_WHY = (
    "PD row: reproduced with C_r = 500,000 N/rad instead of the printed 50,000, on the ellipse of "
    "78.2 m by 41.74 m for 200 s (inferred). With the printed C_r the RMS falls "
    "with mass where the paper's rises, and it would on any path: a steady turn takes a steer of "
    "l + m V² (c_r l_r - c_f l_f)/(c_f c_r l) times its curvature, and c_r l_r < c_f l_f there. "
    "PD+DOB row: its numbers do not come out. (11) with Q of (20) at 5 rad/s leaves 2 to 4 % of "
    "the PD's error, the table 55 to 70 %. A cut-off of 0.065 rad/s alone, fitted, comes within 6 "
    "% in every corner; only what the mass changes is smaller than in the paper. That the DOB "
    "reduces the error in every corner holds."
)


class Row(NamedTuple):
    """One line of the table: four RMS errors [m], in the order of the corners a to d."""

    label: str
    rms_m: tuple[float, ...]


def ellipse_run(
    plant: str, preset: str, rear_cornering_stiffness_n_rad: float, *changed: str
) -> History:
    """Return 200 s of the ellipse with a plant's and a controller's preset, changed as said."""
    overrides = (
        f"duration_s={DURATION_S}",
        f"vehicle.rear_cornering_stiffness_n_rad={rear_cornering_stiffness_n_rad}",
    )
    return simulate(paper_plant(plant, *overrides), controller_preset(preset, changed))


def simulated_row(
    label: str, preset: str, rear_cornering_stiffness_n_rad: float, *changed: str
) -> Row:
    """Return a line as the nodes drive it in the four corners of the uncertainty box."""
    runs = (
        ellipse_run(
            f"paper_corner_{column.corner}", preset, rear_cornering_stiffness_n_rad, *changed
        )
        for column in published.TABLE_2
    )
    return Row(label, tuple(rms(run.lateral_error_m) for run in runs))


def table_2() -> Reproduction:
    """Return the table with either rear cornering stiffness."""
    pd = _rows("PD", "paper_pd", [column.pd_m for column in published.TABLE_2])
    dob = _rows("PD+DOB", "paper_pd_dob", [column.pd_dob_m for column in published.TABLE_2])
    cutoff = f"dob.q_cutoff_rad_s={FITTED_CUTOFF_RAD_S}"
    label = f"PD+DOB, ω_c = {FITTED_CUTOFF_RAD_S:g} rad/s"
    dob.append(simulated_row(label, "paper_pd_dob", CORRECTED, cutoff))
    comparisons = (
        *_comparisons(pd),
        _mass_trend("C_r = 500,000 N/rad", pd[0], pd[1]),
        _mass_trend("C_r = 50,000 N/rad", pd[0], pd[2]),
        *_comparisons(dob),
        _is_reduced(pd[1], dob[1]),
    )
    return Reproduction(
        "table_2",
        "RMS tracking errors of PD and PD with DOB",
        "K_p = 1.0596, K_d = 0.939, ideal derivative; DOB with G_n of (19) and Q of (20), "
        "ω_c = 5 rad/s; sampled at 1 kHz, no delay. Columns: 4 km/h 1600 kg, 4 km/h 5000 kg, "
        "7 km/h 1600 kg, 7 km/h 5000 kg.",
        (Picture("table_2", _draw(pd, dob)),),
        comparisons,
        verdict_of(comparisons),
        _WHY,
    )


def _rows(law: str, preset: str, published_m: Sequence[float]) -> list[Row]:
    return [
        Row(f"{law}, published", tuple(published_m)),
        simulated_row(f"{law}, C_r = 500,000 N/rad", preset, CORRECTED),
        simulated_row(f"{law}, C_r = 50,000 N/rad", preset, PRINTED),
    ]


def _comparisons(rows: Sequence[Row]) -> list[Comparison]:
    """Compare all lines of one law with its published one, which is the first.

    The line after it, as the nodes drive it with the corrected C_r, decides.
    """
    deciding, *others = (_against(rows[0], row) for row in rows[1:])
    return [deciding._replace(decides=NUMBER), *others]


def _against(theirs: Row, ours: Row) -> Comparison:
    worst_m = max(abs(a - b) for a, b in zip(theirs.rms_m, ours.rms_m, strict=True))
    return Comparison(
        f"RMS error: {ours.label}",
        _text(theirs),
        f"{_text(ours)}; off by {worst_m:.4f} m at most",
        worst_m <= TOLERANCE_M,
    )


def _mass_trend(label: str, theirs: Row, ours: Row) -> Comparison:
    """Compare the effect of 3400 kg more on the PD's error, at either speed."""
    return Comparison(
        f"PD, what 1600 → 5000 kg change at 4 and 7 km/h, {label}",
        " ".join(f"{change_m:+.4f}" for change_m in _mass_changes_m(theirs)) + " m",
        " ".join(f"{change_m:+.5f}" for change_m in _mass_changes_m(ours)) + " m",
        all(change_m > 0.0 for change_m in _mass_changes_m(ours)),
    )


def _mass_changes_m(row: Row) -> tuple[float, float]:
    a, b, c, d = row.rms_m
    return b - a, d - c


def _is_reduced(pd: Row, dob: Row) -> Comparison:
    pairs = list(zip(dob.rms_m, pd.rms_m, strict=True))
    return Comparison(
        "RMS without → with DOB",
        published.TABLE_2_CLAIM,
        ", ".join(f"{without:.4f} → {with_dob:.4f} m" for with_dob, without in pairs),
        all(with_dob < without for with_dob, without in pairs),
        CLAIM,
    )


def _text(row: Row) -> str:
    return " ".join(f"{value:.4f}" for value in row.rms_m) + " m"


def _draw(pd: Sequence[Row], dob: Sequence[Row]) -> Figure:
    figure = Figure(figsize=(10.5, 4.4))
    corners = [
        f"{column.corner}: {column.speed_km_h:g} km/h\n{column.virtual_mass_kg:g} kg"
        for column in published.TABLE_2
    ]
    for axes, rows, law in zip(figure.subplots(1, 2), (pd, dob), ("PD", "PD+DOB"), strict=True):
        step = 0.81 / len(rows)
        for index, (row, colour) in enumerate(zip(rows, ("0.55", *COLOURS), strict=False)):
            places, label = np.arange(4) + step * (index - 1), row.label.split(", ", 1)[1]
            bars = axes.bar(places, row.rms_m, step - 0.02, color=colour, label=label)
            axes.bar_label(bars, fmt="%.4f", fontsize=7.5, rotation=90, padding=3)
        axes.set_xticks(range(4), corners)
        axes.set_ylabel("RMS lateral error [m]")
        axes.set(ylim=(0.0, 1.3 * max(max(row.rms_m) for row in rows)), title=law)
        axes.grid(visible=False, axis="x")
    handles, labels = figure.axes[-1].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4)
    return figure
