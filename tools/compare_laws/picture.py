"""The figures of the comparison: worst RMS over delay.

One has a panel for each network, and the legend in the last place of the grid. The other shows some
laws at a constant delay, and the delay at which each breaks.
"""

from collections.abc import Sequence
from itertools import chain, cycle

from matplotlib.figure import Figure

from ...reports.plot_style import plot_style
from .runs import BROKEN_M, CONTESTANTS, NETWORKS, SETTLED_S, Cell, Contestant, breaks_at_s

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
    ("#009E73", "-.", "P"),
    ("#000000", "-.", "X"),
)
_FURTHER_LINES = (("#999933", "-", "x"), ("#882255", "-", "+"))
_SHOWN = {
    "PD as published": ("#D55E00", "-"),
    "PD+DOB as published": ("#E69F00", "-"),
    "PD+DOB": ("#0072B2", "-"),
    "PD+DDOB": ("#009E73", "-"),
    "PD+DDOB, half a second": ("#009E73", "--"),
    "predictor": ("#CC79A7", "-"),
}
"""Laws of the figure with the delays at which they break."""
_TOP_M = 3.0


def draw_comparison(
    cells: Sequence[Cell], further: Sequence[Contestant] = (), *, of_cg: bool = False
) -> Figure:
    """Return the figure, of the point that each law follows or of the centre of gravity."""
    point = "centre of gravity" if of_cg else "followed point"
    with plot_style():
        figure = Figure(figsize=(12.0, 12.4))
        *panels, beside = figure.subplots(3, 2, sharex=True, sharey=True).ravel()
        drawn = (*(one for one in CONTESTANTS if not one.is_continuous), *further)
        for panel, (key, network) in zip(panels, NETWORKS.items(), strict=True):
            lines = chain(_LINES, cycle(_FURTHER_LINES))
            for one, (colour, dashes, marker) in zip(drawn, lines, strict=False):
                own = [
                    cell for cell in cells if (cell.network, cell.contestant) == (key, one.label)
                ]
                panel.plot(
                    [1e3 * cell.delay_s for cell in own],
                    [1e3 * min(_plotted_m(cell, of_cg=of_cg), _TOP_M) for cell in own],
                    ls=dashes,
                    marker=marker,
                    ms=5,
                    markevery=2,
                    color=colour,
                    label=one.label,
                )
            if not of_cg:
                panel.axhline(1e3 * BROKEN_M, color="0.5", lw=0.8, ls=":")
            panel.set(yscale="log", title=network.title)
        if not of_cg:
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
            panel.set_ylabel(f"{point}, worst RMS from {SETTLED_S:g} s on [mm]")
        handles, labels = panels[-1].get_legend_handles_labels()
        beside.set_axis_off()
        beside.legend(handles, labels, loc="center left", fontsize=12.0)
        return figure


def draw_break_points(cells: Sequence[Cell]) -> Figure:
    """Return the figure of some laws at a constant delay, with the delay at which each breaks."""
    with plot_style():
        figure = Figure(figsize=(9.0, 4.8))
        axes = figure.subplots()
        for label, (colour, dashes) in _SHOWN.items():
            own = [cell for cell in cells if (cell.network, cell.contestant) == ("constant", label)]
            delays_ms = [1e3 * cell.delay_s for cell in own]
            errors_mm = [1e3 * min(cell.settled_rms_m, _TOP_M) for cell in own]
            breaks_s = breaks_at_s(own)
            fate = "holds throughout" if breaks_s is None else f"breaks at {1e3 * breaks_s:.0f} ms"
            axes.plot(delays_ms, errors_mm, dashes, color=colour, lw=2.0, label=f"{label}: {fate}")
            if breaks_s is not None:
                place = delays_ms.index(1e3 * breaks_s)
                axes.plot(delays_ms[place], errors_mm[place], "x", color=colour, ms=11, mew=2.5)
        axes.axhspan(1e3 * BROKEN_M, 1e3 * _TOP_M, color="0.93", zorder=0)
        axes.text(
            0.3,
            1.05e3 * BROKEN_M,
            "shaded: does not hold the path",
            transform=axes.get_yaxis_transform(),
            va="bottom",
            fontsize=9,
            color="0.35",
        )
        axes.set_yscale("log")
        axes.set(
            xlabel="constant delay of the commands [ms]",
            ylabel=f"RMS error from {SETTLED_S:g} s on, worst of the box [mm]",
            ylim=(None, 1e3 * _TOP_M),
        )
        axes.set_title("Which delay each law bears")
        figure.legend(loc="outside lower center", ncols=2)
        return figure


def _plotted_m(cell: Cell, *, of_cg: bool) -> float:
    return cell.settled_cg_rms_m if of_cg else cell.followed_m[0]
