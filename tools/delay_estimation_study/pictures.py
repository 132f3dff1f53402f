"""Picture of the delay estimation: estimate and echo over time against the truth.

A title names the path, the corner of the box, the noise of the lateral error, and the network.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ...reports.plot_style import COLOURS, plot_style
from .runs import DURATION_S, TOLERANCE_S, Case, History, run_case

_LAW = "pd_ddob"
_NETWORKS = ("80 ms", "250 ms", "2 x 80 ± 30 ms")
_ROWS = (
    ("double lane change", "a", 0.0),
    ("double lane change", "d", 0.02),
    ("ellipse 60 x 30 m", "d", 0.0),
)
"""The cases shown, where they were requested; all of them would be too many for one picture."""
_SPAN_MS = 25.0
"""Range shown on either side of the truth."""


def shown(cases: Sequence[Case]) -> list[list[Case]]:
    """Return the cases of the panels, in rows of one path, corner and noise; one at the least."""
    laws = [case.law for case in cases]
    law = _LAW if _LAW in laws else laws[0]
    rows = [
        [
            case
            for network in _NETWORKS
            for case in cases
            if case == Case(law, road, corner, network, noise_m)
        ]
        for road, corner, noise_m in _ROWS
    ]
    return [row for row in rows if row] or [[cases[0]]]


def draw(path: Path, cases: Sequence[Case]) -> None:
    """Run what is shown of ``cases``, and write the picture."""
    rows = shown(cases)
    with plot_style():
        figure = Figure(figsize=(12.0, 8.0))
        axes = figure.subplots(len(rows), len(rows[0]), sharex=True, squeeze=False)
        for row, cases_of_row in enumerate(rows):
            for column, case in enumerate(cases_of_row):
                _panel(axes[row, column], run_case(case)[1])
                axes[row, column].set_title(
                    f"{case.path}, {case.corner}, {100 * case.noise_m:g} cm, {case.network}",
                    fontsize=8,
                )
        for axis in axes[-1]:
            axis.set_xlabel("time [s]")
        for axis in axes[:, 0]:
            axis.set_ylabel("delay [ms]")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=5)
        figure.savefig(path)


def _panel(axis: Axes, history: History) -> None:
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
    axis.set(ylim=(low_ms, truth_ms + _SPAN_MS), xlim=(0.0, DURATION_S))
