"""Figures 14 and 15: the desired path and its curvature.

    x = a cos t,  y = b sin t        ρ = a b / (a² sin² t + b² cos² t)^(3/2)

The text calls the path elliptical and gives neither axes nor start nor duration. The axes here are
chosen such that Table II's PD row comes out, from the end of the major axis on, in 200 s. They are
not the only ones: 86.8 m by 32.3 m in 100 s does the same, which the comparisons show.
"""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from ...closed_loop.reports.plot_style import COLOURS
from ...plant_emulator.path.ellipse_and_lane_changes import ellipse
from ...plant_emulator.path.path import Path, curvature, pose
from ...plant_emulator.path.settings import EllipseSettings
from ...runtime.array_types import FloatArray
from . import published
from .continuous_runs import PD, DrivenEllipse, table_2_row
from .result import Comparison, Picture, Reproduction, Verdict, unpublished

_POINTS = 801
_PD_TOLERANCE_M = 2e-4
_LEGEND = "semi-axes and duration that fit Table II"

_WHY = (
    "The text gives neither the ellipse's axes, nor the start, nor how long is driven. The axes "
    "are inferred: started at the end of the major axis and driven for 200 s, "
    "78.2 m by 41.74 m give Table II's PD row within 0.0002 m (with C_r = 500,000 N/rad). "
    "So do 86.8 m by 32.3 m in 100 s, so the fit does not determine the axes."
)


_FIT = DrivenEllipse(
    EllipseSettings().semi_major_axis_m, EllipseSettings().semi_minor_axis_m, 200.0
)
_OTHER = DrivenEllipse(86.8, 32.3, 100.0)
_DRAWN: tuple[tuple[DrivenEllipse, str, dict[str, Any]], ...] = (
    (_FIT, "", {"color": COLOURS[0]}),
    (_OTHER, "other_", {"color": "0.5", "ls": "--", "lw": 1.0}),
)
"""Ellipses, what begins the names of their columns, and their lines."""


def figure_14() -> Reproduction:
    """Return the desired path, seen from above."""
    figure = Figure(figsize=(8.5, 5.2))
    axes = figure.subplots()
    columns: dict[str, FloatArray] = {}
    for fit, prefix, style in _DRAWN:
        path = _path(fit)
        poses = [pose(path, s) for s in np.linspace(0.0, path.length_m, _POINTS)]
        x_m, y_m = np.array([p.x_m for p in poses]), np.array([p.y_m for p in poses])
        axes.plot(x_m, y_m, label=f"{fit}", **style)
        columns |= {f"{prefix}x_m": x_m, f"{prefix}y_m": y_m}
    start_m = (_FIT.semi_major_axis_m, 0.0)
    axes.plot(*start_m, "o", color="black")
    axes.annotate("start", start_m, xytext=(-40, 4), textcoords="offset points")
    axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", title="Desired path")
    axes.legend(loc="center", title=_LEGEND)
    return Reproduction(
        "figure_14",
        "Desired path used in the simulation",
        "Used everywhere here: semi-axes 78.2 m by 41.74 m, to the left, from the end of the major "
        "axis. Dashed: another ellipse that reproduces Table II's PD row as well.",
        (Picture("figure_14", figure, columns),),
        (
            Comparison("shape", published.FIGURE_14, "an ellipse", None),
            unpublished("semi-axes", f"{_FIT}"),
            _fit_comparison(_FIT),
            _fit_comparison(_OTHER),
        ),
        Verdict.NOT_REPRODUCIBLE,
        _WHY,
    )


def figure_15() -> Reproduction:
    """Return the curvature of the desired path over its arc length."""
    figure = Figure(figsize=(8.5, 4.2))
    axes = figure.subplots()
    columns: dict[str, FloatArray] = {}
    for fit, prefix, style in _DRAWN:
        path = _path(fit)
        s_m = np.linspace(0.0, path.length_m, _POINTS)
        rho_1_m = np.array([curvature(path, s) for s in s_m])
        axes.plot(s_m, rho_1_m, label=f"{fit}", **style)
        columns |= {f"{prefix}arc_length_m": s_m, f"{prefix}curvature_1_m": rho_1_m}
    axes.set(xlabel="arc length [m]", ylabel="curvature of the path [1/m]", ylim=(0.0, None))
    axes.set_title("Curvature of the desired path")
    axes.legend(loc="upper center", bbox_to_anchor=(0.27, 1.0), title=_LEGEND)
    a, b, _ = _FIT
    rho_1_m = columns["curvature_1_m"]
    return Reproduction(
        "figure_15",
        "Curvature of the desired path",
        f"Over one lap of {_path(_FIT).length_m:.1f} m from the start. "
        "Dashed: the other ellipse of Figure 14.",
        (Picture("figure_15", figure, columns),),
        (
            unpublished(
                "largest curvature",
                f"{np.max(rho_1_m):.5f} 1/m; closed form a/b² = {a / b**2:.5f} 1/m",
            ),
            unpublished(
                "smallest curvature",
                f"{np.min(rho_1_m):.5f} 1/m; closed form b/a² = {b / a**2:.5f} 1/m",
            ),
        ),
        Verdict.NOT_REPRODUCIBLE,
        _WHY,
    )


def _path(fit: DrivenEllipse) -> Path:
    return ellipse(fit.semi_major_axis_m, fit.semi_minor_axis_m)


def _fit_comparison(fit: DrivenEllipse) -> Comparison:
    """Compare the PD row that an ellipse gives with the published one."""
    ours_m = table_2_row(PD, fit)
    theirs_m = [column.pd_m for column in published.TABLE_2]
    worst_m = max(abs(ours - theirs) for ours, theirs in zip(ours_m, theirs_m, strict=True))
    return Comparison(
        f"PD row of Table II on {fit}",
        " ".join(f"{value:.4f}" for value in theirs_m) + " m",
        " ".join(f"{value:.4f}" for value in ours_m) + " m",
        worst_m <= _PD_TOLERANCE_M,
    )
