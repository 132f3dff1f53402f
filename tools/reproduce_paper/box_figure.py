"""Figure 2 of SAE 2018-01-1086: the parametric uncertainty box, V by m/μ."""

import numpy as np
from matplotlib.figure import Figure

from ...loop_theory.uncertainty import paper_box
from ...reports.plot_style import COLOURS
from ...runtime.array_types import FloatArray
from .corners import corner_labels
from .result import Comparison, Picture, Reproduction, Verdict


def figure_2() -> Reproduction:
    """Return the uncertainty box with its vertices."""
    box = paper_box()
    speeds_km_h = np.array([3.6 * vehicle.speed_m_s for vehicle in box.vertices()])
    masses_kg = np.array([vehicle.virtual_mass_kg for vehicle in box.vertices()])
    lightest_kg, heaviest_kg = 1600.0 / 1.0, 2000.0 / 0.4
    figure = _draw_box(speeds_km_h, masses_kg)
    return Reproduction(
        key="figure_02",
        title="Figure 2: parametric uncertainty box",
        caption="V from 4 to 7 km/h, m from 1600 to 2000 kg, μ from 0.4 to 1; nominal 5 km/h,"
        " 2000 kg, μ = 1.",
        pictures=(
            Picture("figure_02", figure, {"speed_km_h": speeds_km_h, "virtual_mass_kg": masses_kg}),
        ),
        comparisons=(
            Comparison(
                "virtual mass m/μ",
                "1600 to 5000 kg",
                f"{lightest_kg:.0f} to {heaviest_kg:.0f} kg",
                (masses_kg.min(), masses_kg.max()) == (lightest_kg, heaviest_kg),
            ),
        ),
        verdict=Verdict.REPRODUCED,
        why="Arithmetic on the text's ranges. Which letter is which vertex is not in the text; here"
        " they follow the columns of Table II.",
    )


def _draw_box(speeds_km_h: FloatArray, masses_kg: FloatArray) -> Figure:
    nominal = paper_box().nominal
    nominal_km_h = 3.6 * nominal.speed_m_s
    figure = Figure(figsize=(6.4, 4.6))
    axes = figure.subplots()
    outline = [0, 1, 3, 2, 0]
    axes.fill(speeds_km_h[outline], masses_kg[outline], color=COLOURS[1], alpha=0.12)
    axes.plot(speeds_km_h[outline], masses_kg[outline], color=COLOURS[1])
    axes.plot(nominal_km_h, nominal.virtual_mass_kg, "kx", ms=8)
    axes.annotate(
        f"nominal: {nominal_km_h:.0f} km/h, {nominal.virtual_mass_kg:.0f} kg",
        (nominal_km_h, nominal.virtual_mass_kg),
        xytext=(8, 6),
        textcoords="offset points",
    )
    for label, speed_km_h, mass_kg in zip(corner_labels(), speeds_km_h, masses_kg, strict=True):
        axes.plot(speed_km_h, mass_kg, "o", color=COLOURS[0])
        axes.annotate(
            label,
            (speed_km_h, mass_kg),
            xytext=(0, 8 if mass_kg > nominal.virtual_mass_kg else -17),
            textcoords="offset points",
            ha="center",
        )
    axes.set(xlabel="speed V [km/h]", ylabel="virtual mass m/μ [kg]")
    axes.set(xlim=(3.2, 7.8), ylim=(1000.0, 5600.0), title="Uncertainty box")
    return figure
