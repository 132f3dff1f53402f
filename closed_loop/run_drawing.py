"""Draws one simulated run: lateral error, steer, estimates and latency over time."""

import numpy as np
from matplotlib.figure import Figure

from .reports.plot_style import COLOURS, plot_style
from .run_tables import ControllerTable, PlantTable


def draw_run(title: str, plant: PlantTable, controller: ControllerTable) -> Figure:
    """Return the figure of a run."""
    with plot_style():
        figure = Figure(figsize=(9.0, 8.0), dpi=110)
        error, steer, estimates, latency = figure.subplots(4, 1, sharex=True)
        for values_m, label, colour in (
            (plant.lateral_error_m, "preview point", COLOURS[1]),
            (plant.cg_deviation_m, "centre of gravity", COLOURS[0]),
        ):
            error.plot(plant.time_s, 1e3 * values_m, color=colour, label=label, lw=1.0)
        error.axhline(0.0, color="black", lw=0.6)
        error.set(ylabel="off the path [mm]", title=title)
        steer.step(controller.time_s, controller.sent_rad, where="post", label="sent", lw=1.0)
        steer.plot(plant.time_s, plant.wheel_angle_rad, label="wheel", lw=1.0)
        steer.set(ylabel="steer [rad]")
        for values, label in (
            (controller.disturbance_rad, "disturbance (DOB)"),
            (controller.network_disturbance_rad, "network disturbance (CDOB)"),
        ):
            if np.any(values):
                estimates.plot(controller.time_s, values, label=label, lw=1.0)
        estimates.set(ylabel="estimates [rad]")
        latency.plot(plant.time_s, 1e3 * plant.downlink_latency_s, ".", ms=2.5, label="downlink")
        latency.plot(plant.time_s, 1e3 * plant.uplink_latency_s, ".", ms=2.5, label="uplink")
        latency.set(xlabel="time [s]", ylabel="latency [ms]", ylim=(0.0, None))
        for axes in (error, steer, estimates, latency):
            if axes.get_legend_handles_labels()[1]:
                axes.legend(loc="lower right", bbox_to_anchor=(1.0, 0.97), ncols=2, markerscale=3.0)
    return figure
