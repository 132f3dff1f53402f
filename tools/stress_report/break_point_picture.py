"""Break-points over jitter: the median over seeds, its confidence interval, and what is held."""

import numpy as np
from matplotlib.figure import Figure

from tools.demo_figures import COLOURS
from tools.stress_report.axes import StudyAxes
from tools.stress_report.break_points import CONFIDENCE, HELD_SHARE, LATENCY_NS_MAX, BreakPoint

_MARKERS = "os^Dv<>p"


def draw_break_points(points: list[BreakPoint], axes: StudyAxes, names: tuple[str, ...]) -> Figure:
    """Draw the break-point of each law over jitter."""
    figure = Figure(figsize=(9.5, 4.6))
    panel = figure.subplots()
    chosen = sorted({point.jitter for point in points})
    end_ms = 1e-6 * LATENCY_NS_MAX
    for controller, name in enumerate(names):
        own = [point for point in points if point.controller == controller]
        # Beside each other, or laws of the same break-point hide each other.
        at = np.array([chosen.index(point.jitter) for point in own]) + 0.06 * (
            controller - 0.5 * (len(names) - 1)
        )
        colour = COLOURS[controller % len(COLOURS)]
        median, low, high, held = (
            1e3 * np.clip([getattr(point, name) for point in own], 0.0, 1e-3 * end_ms)
            for name in ("median_s", "low_s", "high_s", "held_s")
        )
        panel.errorbar(
            at,
            median,
            (median - low, high - median),
            color=colour,
            marker=_MARKERS[controller % len(_MARKERS)],
            ms=5,
            capsize=3,
            label=name,
        )
        panel.plot(at, held, ls="", marker="_", ms=11, mew=2, color=colour)
    panel.axhline(end_ms, color="0.4", lw=0.8, ls="--")
    panel.text(-0.3, end_ms, "end of the search: held here and beyond", va="bottom", fontsize=8.5)
    panel.set_xticks(range(len(chosen)), [axes.jitter.labels[place] for place in chosen])
    panel.set_xlabel(axes.jitter.title)
    panel.set_ylabel("largest mean latency held [ms]")
    panel.set_ylim(0.0, 1.1 * end_ms if _is_near(points) else None)
    if not _is_near(points):
        panel.set_ylim(0.0, 1.2e3 * max(point.by_seed_s[-1] for point in points) + 1.0)
    panel.set_title(
        f"Markers: median over seeds with its {100 * CONFIDENCE:g} % interval.  "
        f"Bars: held by at least {100 * HELD_SHARE:g} % of seeds, {100 * CONFIDENCE:g} % sure",
        fontsize=9.5,
        fontweight="normal",
    )
    panel.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure


def _is_near(points: list[BreakPoint]) -> bool:
    """Whether the end of the search is worth showing."""
    return any(point.by_seed_s[-1] > 0.8e-9 * LATENCY_NS_MAX for point in points)
