"""The figure of the comparison: worst RMS over delay, a panel for each network.

Of the six places of the grid the last is the legend's.
"""

from collections.abc import Sequence
from itertools import chain, cycle

from matplotlib.figure import Figure

from ...reports.plot_style import plot_style
from .runs import BROKEN_M, CONTESTANTS, NETWORKS, SETTLED_S, Cell, Contestant

_LINES = (
    ("#D55E00", "-", "o"),
    ("#D55E00", "--", ""),
    ("#E69F00", "-", "s"),
    ("#0072B2", "-", "^"),
    ("#009E73", "-", "D"),
    ("#009E73", "--", ""),
    ("#009E73", ":", ""),
    ("#CC79A7", "-", "v"),
    ("#56B4E9", "-", "<"),
    ("#000000", "-", "*"),
    ("#000000", "--", ""),
)
_FURTHER_LINES = (("#999933", "-", "x"), ("#882255", "-", "+"))
_TOP_M = 3.0


def draw_comparison(cells: Sequence[Cell], further: Sequence[Contestant] = ()) -> Figure:
    """Return the figure."""
    with plot_style():
        figure = Figure(figsize=(12.0, 12.4))
        *panels, beside = figure.subplots(3, 2, sharex=True, sharey=True).ravel()
        for panel, (key, network) in zip(panels, NETWORKS.items(), strict=True):
            lines = chain(_LINES, cycle(_FURTHER_LINES))
            for one, (colour, dashes, marker) in zip((*CONTESTANTS, *further), lines, strict=False):
                own = [
                    cell for cell in cells if (cell.network, cell.contestant) == (key, one.label)
                ]
                panel.plot(
                    [1e3 * cell.delay_s for cell in own],
                    [1e3 * min(cell.settled_rms_m, _TOP_M) for cell in own],
                    ls=dashes,
                    marker=marker,
                    ms=5,
                    markevery=2,
                    color=colour,
                    label=one.label,
                )
            panel.axhline(1e3 * BROKEN_M, color="0.5", lw=0.8, ls=":")
            panel.set_yscale("log")
            panel.set_title(network.title)
        panels[0].annotate(
            "above: does not hold the path",
            (0.01, 1e3 * BROKEN_M),
            (0.0, 3.0),
            xycoords=("axes fraction", "data"),
            textcoords="offset points",
            fontsize=8.5,
            color="0.35",
        )
        for panel in panels[-2:]:
            panel.set_xlabel("mean latency of the commands [ms]")
            panel.tick_params(labelbottom=True)
        for panel in panels[::2]:
            panel.set_ylabel(f"worst RMS error from {SETTLED_S:g} s on [mm]")
        handles, labels = panels[-1].get_legend_handles_labels()
        beside.set_axis_off()
        beside.legend(handles, labels, loc="center left", fontsize=12.0)
        return figure
