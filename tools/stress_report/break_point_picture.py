"""Break-points over jitter: the median over seeds, its confidence interval, and what is held."""

import numpy as np
from matplotlib.figure import Figure

from ...reports.plot_style import COLOURS
from .axes import StudyAxes
from .break_points import CONFIDENCE, HELD_SHARE, LATENCY_NS_MAX, STEP_NS, BreakPoint

_MARKERS = "os^Dv<>p"
_TICKS_MS = (10, 20, 50, 100, 150, 200, 300, 400, 500, 700, 1000, 1500, 2000)
_SHORTEST_MS = 1e-6 * STEP_NS
"""Where latency 0, or not even that, is drawn: the axis is logarithmic."""


def draw_break_points(points: list[BreakPoint], axes: StudyAxes, names: tuple[str, ...]) -> Figure:
    """Draw the break-point of each law over jitter."""
    figure = Figure(figsize=(9.5, 4.6))
    panel = figure.subplots()
    chosen = sorted({point.jitter for point in points})
    end_ms = 1e-6 * LATENCY_NS_MAX
    for controller, name in enumerate(names):
        own = [point for point in points if point.controller == controller]
        # Beside each other, since laws of the same break-point would hide each other.
        at = np.array([chosen.index(point.jitter) for point in own]) + 0.06 * (
            controller - 0.5 * (len(names) - 1)
        )
        colour = COLOURS[controller % len(COLOURS)]
        median, low, high, held = (
            np.clip([1e3 * getattr(point, name) for point in own], _SHORTEST_MS, end_ms)
            for name in ("median_s", "low_s", "high_s", "held_s")
        )
        bars, marker = (median - low, high - median), _MARKERS[controller % len(_MARKERS)]
        panel.errorbar(at, median, bars, color=colour, marker=marker, ms=5, capsize=3, label=name)
        panel.plot(at, held, ls="", marker="_", ms=11, mew=2, color=colour)
    panel.set_yscale("log")
    low_ms, high_ms = panel.get_ylim()
    if high_ms > 0.8 * end_ms:
        panel.axhline(end_ms, color="0.4", lw=0.8, ls="--")
        panel.annotate(
            "end of the search: held here and beyond",
            (0.02, end_ms),
            (0.0, 3.0),
            xycoords=("axes fraction", "data"),
            textcoords="offset points",
            fontsize=8.5,
        )
        high_ms = 1.3 * end_ms
    panel.set_ylim(low_ms, high_ms)
    ticks_ms = [tick for tick in _TICKS_MS if low_ms <= tick <= high_ms]
    panel.set_yticks(ticks_ms, [f"{tick:g}" for tick in ticks_ms])
    panel.set_yticks([], minor=True)
    panel.set_xticks(range(len(chosen)), [axes.jitter.labels[place] for place in chosen])
    panel.set(xlabel=axes.jitter.title, ylabel="largest mean latency held [ms]")
    panel.set_title(
        f"Markers: median over seeds with its {100 * CONFIDENCE:g} % interval.  "
        f"Bars: held by at least {100 * HELD_SHARE:g} % of seeds, {100 * CONFIDENCE:g} % sure",
        fontsize=9.5,
        fontweight="normal",
    )
    panel.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure
