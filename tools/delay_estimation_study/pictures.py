"""Picture of the delay estimation: estimate and echo over time against the truth.

A title names the path, the corner of the box, the noise of the lateral error, and the network.
"""

from itertools import product
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...reports.plot_style import COLOURS, plot_style
from .runs import DURATION_S, TOLERANCE_S, Case, History, run_case

_NETWORKS = ("80 ms", "250 ms", "2 x 80 ± 30 ms")
_ROWS = (
    ("double lane change", "a", 0.0),
    ("double lane change", "d", 0.02),
    ("ellipse 60 x 30 m", "d", 0.0),
)
_SPAN_MS = 25.0
"""Shown to either side of the truth."""


def draw(path: Path) -> None:
    """Run what is shown, with pd_ddob, and write the picture."""
    with plot_style():
        figure = Figure(figsize=(12.0, 8.0))
        axes = figure.subplots(len(_ROWS), len(_NETWORKS), sharex=True, squeeze=False)
        for (row, (road, corner, noise_m)), (column, network) in product(
            enumerate(_ROWS), enumerate(_NETWORKS)
        ):
            history = run_case(Case("pd_ddob", road, corner, network, noise_m))[1]
            _panel(axes[row, column], history)
            axes[row, column].set_title(
                f"{road}, {corner}, {100 * noise_m:g} cm, {network}", fontsize=8
            )
        for axis in axes[-1]:
            axis.set_xlabel("time [s]")
        for axis in axes[:, 0]:
            axis.set_ylabel("delay [ms]")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=5)
        figure.savefig(path)


def _panel(axis: Axes, history: History) -> None:
    """Draw one run."""
    truth_ms, tolerance_ms = 1e3 * history.truth_s, 1e3 * TOLERANCE_S
    axis.axhspan(
        truth_ms - tolerance_ms,
        truth_ms + tolerance_ms,
        color="0.9",
        label="truth ± one control period",
    )
    axis.axhline(truth_ms, color="0.4", linewidth=1.0, label="truth")
    axis.plot(
        history.time_s, 1e3 * history.echo_s, color=COLOURS[0], linewidth=1.0, label="by echo"
    )
    axis.plot(history.time_s, 1e3 * history.estimate_s, color=COLOURS[1], label="estimate")
    low_ms = truth_ms - _SPAN_MS
    nothing = np.where(np.isnan(history.estimate_s), low_ms + 1.0, np.nan)
    axis.plot(history.time_s, nothing, color=COLOURS[3], linewidth=4.0, label="not observable now")
    axis.set_ylim(low_ms, truth_ms + _SPAN_MS)
    axis.set_xlim(0.0, DURATION_S)
