"""Picture over mean latency and jitter: heat maps of the RMS error, one a law.

A cell of a heat map holds the worst over everything else that varies (corners of the box, ...):

    RMS     the largest of the medians over replicates
    held    the smallest share of replicates that hold the path

All laws share one scale of colours. Hatched are cells with a run that does not hold.
"""

from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import LogLocator

from ...closed_loop.reports.page import Picture, Section
from ...closed_loop.studies.result_reader import Rows
from ...runtime.array_types import FloatArray
from .axes import StudyAxes, cells

_COLUMNS = 2


class HeatMaps(NamedTuple):
    """Arrays of shape (controllers, jitters, means); NaN where nothing was run."""

    rms_m: FloatArray
    held: FloatArray


def are_drawn(axes: StudyAxes) -> bool:
    """Whether a report has heat maps; one row or column says less than the table of the laws."""
    return len(axes.jitter.labels) >= 2 and len(axes.mean.labels) >= 2


def heat_maps(rows: Rows, axes: StudyAxes, controllers: int) -> HeatMaps:
    """Return the worst of each cell."""
    cell, shape = cells(axes, rows, controllers)
    count = int(np.prod(shape))
    keys, place = np.unique(cell * (int(axes.group.max()) + 1) + axes.group, return_inverse=True)
    cell_of = keys // (int(axes.group.max()) + 1)
    sizes = np.bincount(place)
    order = np.lexsort((np.where(np.isnan(rows.rms_m), np.inf, rows.rms_m), place))
    middle = np.cumsum(sizes) - sizes + (sizes - 1) // 2
    medians_m = rows.rms_m[order[middle]]
    shares = np.bincount(place, weights=rows.holds) / sizes
    rms_m, held = np.full(count, -np.inf), np.full(count, np.inf)
    np.maximum.at(rms_m, cell_of, np.where(np.isnan(medians_m), np.inf, medians_m))
    np.minimum.at(held, cell_of, shares)
    return HeatMaps(
        np.where(np.isfinite(rms_m), rms_m, np.nan).reshape(shape),
        np.where(np.isfinite(held), held, np.nan).reshape(shape),
    )


def draw_rms(maps: HeatMaps, axes: StudyAxes, names: tuple[str, ...]) -> Figure:
    """Draw the RMS error; the scale is logarithmic, from 1 mm or more to 10 m or less."""
    values_mm = 1e3 * maps.rms_m
    known_mm = values_mm[np.isfinite(values_mm)]
    low, high = (float(np.clip(f(known_mm, initial=10.0), 1.0, 1e4)) for f in (np.min, np.max))
    norm = LogNorm(low, max(high, 1.01 * low))
    columns = min(_COLUMNS, len(names))
    lines = -(-len(names) // columns)
    means, jitters = len(axes.mean.values), len(axes.jitter.values)
    width = min(max(0.5 * means + 1.2, 4.0), 7.5) * columns + 1.4
    height = min(max(0.42 * jitters + 1.0, 2.2), 5.0) * lines + 1.0
    figure = Figure(figsize=(width, height))
    panels = figure.subplots(lines, columns, sharex=True, sharey=True, squeeze=False)
    for panel in panels.flat[len(names) :]:
        panel.set_visible(False)
    edges = (np.arange(means + 1) - 0.5, np.arange(jitters + 1) - 0.5)
    for place, (name, panel) in enumerate(zip(names, panels.flat, strict=False)):
        panel.set_facecolor("0.75")
        panel.grid(visible=False)
        mesh = panel.pcolormesh(*edges, values_mm[place], norm=norm, cmap="viridis_r")
        for row, column in np.argwhere(maps.held[place] < 1.0).tolist():
            _hatch(panel, row, column)
        panel.set_title(name, fontsize=10)
        panel.set_xticks(*_ticks(axes.mean.labels, 12))
        panel.set_yticks(*_ticks(axes.jitter.labels, 10))
        panel.tick_params(labelbottom=place + columns >= len(names))
    figure.supxlabel(axes.mean.title, fontsize=10)
    figure.supylabel(axes.jitter.title, fontsize=10)
    title = "RMS error of the preview point [mm],\nworst over all else"
    bar = figure.colorbar(mesh, ax=panels, label=title, shrink=0.9, pad=0.02)
    bar.ax.yaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))  # of all, labels would overlap
    for axis_format in (bar.ax.yaxis.set_major_formatter, bar.ax.yaxis.set_minor_formatter):
        axis_format("{x:g}")
    return figure


def _hatch(panel: Axes, row: int, column: int) -> None:
    for colour, width in (("white", 2.2), ("0.1", 0.7)):  # visible on any colour
        patch = Rectangle(
            (column - 0.5, row - 0.5), 1.0, 1.0, fill=False, hatch="///", edgecolor=colour, lw=0.0
        )
        patch.set_hatch_linewidth(width)
        panel.add_patch(patch)


def _ticks(labels: tuple[str, ...], count: int) -> tuple[list[int], list[str]]:
    stride = -(-len(labels) // count)
    places = list(range(0, len(labels), stride))
    return places, [labels[place] for place in places]


def map_section(axes: StudyAxes, picture: Picture) -> Section:
    """Return the heat maps."""
    others = f" ({', '.join(axes.others)})" if axes.others else ""
    return Section(
        "Mean latency and jitter",
        (
            f"Each cell shows the worst over everything else that varies{others}: the largest of "
            "the medians over replicates of the RMS lateral error. All laws have one scale of "
            "colours. A cell is hatched if any run in it does not hold, however few.",
        ),
        (picture,),
    )
