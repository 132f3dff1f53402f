"""The tables of the comparison, as text and as Markdown, and its pictures: worst RMS over delay."""

from collections.abc import Iterable, Mapping, Sequence
from itertools import chain, cycle

from matplotlib.figure import Figure

from ...closed_loop.reports.plot_style import plot_style
from .runs import (
    BROKEN_M,
    CONTESTANTS,
    NETWORKS,
    SETTLED_S,
    Cell,
    Contestant,
    breaks_at_s,
    contestants_of,
)

SHOWN_MS = (0, 100, 200, 300, 400, 500, 600)
COMPACT_MS = (100, 200, 300, 400, 500)
SHOWN_M_MAX = 0.3
"""A larger RMS is not printed. A law that follows the preview point leaves the centre of gravity up
to some 140 mm off the path."""
CellsByMs = Mapping[int, Cell]


def table_lines(cells: Sequence[Cell], further: Sequence[Contestant] = ()) -> list[str]:
    """Return a table for each network: RMS [mm] at some delays, and where each law breaks."""
    shown = _measured(cells, SHOWN_MS)
    lines = []
    for key, network in NETWORKS.items():
        lines += ["", f"{network.title}: worst RMS over the box [mm]"]
        lines.append(f"{'delay [ms]':24}" + "".join(f"{ms:>9}" for ms in shown) + "   breaks at")
        for one in contestants_of(network, further):
            own = _cells_of(cells, key, one.label)
            settled = "".join(f"{_in_mm(own[ms].settled_rms_m, '!'):>9}" for ms in shown)
            whole = "".join(f"{_in_mm(own[ms].rms_m, '!'):>9}" for ms in shown)
            cg = "".join(f"{_in_mm(own[ms].settled_cg_rms_m, '!'):>9}" for ms in shown)
            unit = "" if (breaks := _breaks(own)) == "-" else " ms"
            lines.append(f"{one.label:24}{settled}   {breaks}{unit}")
            lines.append(f"{'  the whole run':24}{whole}")
            lines.append(f"{'  centre of gravity':24}{cg}")
    return [
        *lines,
        f"\nA law's own row: preview point, from {SETTLED_S:g} s on; below it the whole run and the"
        f"\ncentre of gravity, from {SETTLED_S:g} s on, which laws named CG hold on the path.",
        f"breaks at: first delay at which the followed point has more than {1e3 * BROKEN_M:g} mm"
        f" from {SETTLED_S:g} s on; ! is beyond {1e3 * SHOWN_M_MAX:g} mm",
    ]


def markdown_lines(cells: Sequence[Cell], further: Sequence[Contestant] = ()) -> list[str]:
    """Return the first network in full, where each law breaks, and the other networks."""
    shown, compact = _measured(cells, SHOWN_MS), _measured(cells, COMPACT_MS)
    (first, network), *others = NETWORKS.items()
    full, of_cg = [], []
    for one in contestants_of(network, further):
        own = _cells_of(cells, first, one.label)
        full.append([one.label, *(_with_whole_run(own[ms]) for ms in shown)])
        of_cg.append([one.label, *(_in_mm(own[ms].settled_cg_rms_m) for ms in shown)])
    breaks, beside = [], []
    for one in (*CONTESTANTS, *further):
        own_by_network = {key: _cells_of(cells, key, one.label) for key in NETWORKS}
        breaks.append([one.label, *(_breaks(own) for own in own_by_network.values())])
        if any(own_by_network[key] for key, _ in others):
            beside.append([one.label, *(_some(own_by_network[key], compact) for key, _ in others)])
    delays = " / ".join(str(ms) for ms in compact)
    return [
        *_markdown(["followed point, RMS [mm] at", *(f"{ms} ms" for ms in shown)], full),
        "",
        *_markdown(["centre of gravity, RMS [mm] at", *(f"{ms} ms" for ms in shown)], of_cg),
        "",
        *_markdown(["breaks at [ms]", *(one.short for one in NETWORKS.values())], breaks),
        "",
        *_markdown([f"RMS [mm] at {delays} ms", *(one.short for _, one in others)], beside),
    ]


def _cells_of(cells: Sequence[Cell], network: str, label: str) -> CellsByMs:
    return {
        round(1e3 * cell.delay_s): cell
        for cell in cells
        if (cell.network, cell.contestant) == (network, label)
    }


def _measured(cells: Sequence[Cell], asked_ms: Sequence[int]) -> list[int]:
    measured = {round(1e3 * cell.delay_s) for cell in cells}
    return [ms for ms in asked_ms if ms in measured]


def _breaks(own: CellsByMs) -> str:
    """Return the first delay [ms] at which a law breaks; nothing if it does not take part."""
    if not own:
        return ""
    broken_s = breaks_at_s(list(own.values()))
    return "-" if broken_s is None else f"{1e3 * broken_s:.0f}"


def _with_whole_run(cell: Cell) -> str:
    settled_m, whole_m = cell.followed_m
    if settled_m > BROKEN_M:
        return "-"
    return f"{_in_mm(settled_m)} ({_in_mm(whole_m)})"


def _some(own: CellsByMs, some_ms: Sequence[int]) -> str:
    shown_m = [own[ms].followed_m[0] for ms in some_ms] if own else []
    return " / ".join(_in_mm(value_m, at_most_m=BROKEN_M) for value_m in shown_m)


def _in_mm(rms_m: float, beyond: str = "-", at_most_m: float = SHOWN_M_MAX) -> str:
    if rms_m > at_most_m:
        return beyond
    return f"{1e3 * rms_m:.2f}" if rms_m < 0.01 else f"{1e3 * rms_m:.1f}"


def _markdown(heading: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    return [
        f"| {' | '.join(cells).rstrip()} |" for cells in (heading, ["---"] * len(heading), *rows)
    ]


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
                own = _cells_of(cells, key, one.label).values()
                errors_m = (c.settled_cg_rms_m if of_cg else c.followed_m[0] for c in own)
                panel.plot(
                    [1e3 * cell.delay_s for cell in own],
                    [1e3 * min(error_m, _TOP_M) for error_m in errors_m],
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
            own = list(_cells_of(cells, "constant", label).values())
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
