"""The whole frontier, computed in worker processes: tables, a file and pictures."""

import csv
import math
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import as_completed
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from ....closed_loop.processes.parallel_work import worker_pool
from ....closed_loop.reports.plot_style import law_styles, plot_style
from ....closed_loop.reports.terminal import counting_bars, plain_console
from ....controller.laws.predictor import NAME as PREDICTOR
from ....runtime.output_file import open_text
from ..search.law_parameters import KEYS
from ..specification import controller_law
from ..vehicle_file import VehicleFile
from .points import Point, designed_points, predictor_points
from .settings import STRUCTURES, FrontierSettings, Panel, panels_of

_MARKS = {"PD + map": "s", "PID + heading": "^"}
"""Of structures that have the line of another one; all others have a dot."""


def draw_frontier(panels: Sequence[Panel], points: Sequence[Point]) -> Figure:
    """Draw panels side by side, one line for each structure; a cross where a run is lost."""
    figure = Figure(figsize=(8.0 if len(panels) == 1 else 6.0 * len(panels), 5.0))
    (row,) = figure.subplots(1, len(panels), squeeze=False, sharey="row")
    for axes, panel in zip(row, panels, strict=True):
        _draw_panel(axes, panel, points)
    row[0].set_ylabel("RMS of the car, without noise [mm]")
    figure.legend(
        *row[0].get_legend_handles_labels(),
        title="structure: what it reads with the lateral error",
        fontsize=8,
        ncols=2,
        loc="outside upper center",
    )
    asked = panels[0].asked
    noise = ", ".join(f"{panel.table.noise_gain_rad_m_max:g}" for panel in panels)
    figure.text(
        0.01, -0.02,
        f"Worst of the vehicle's corners and of all delays up to the one shown, from"
        f" {asked.ignore_s:g} s on; noise on the wheel at most {noise} rad"
        f" per m;\npeak sensitivity at most {asked.peak_sensitivity_max:g}; stable to"
        f" {1.0 + asked.margin_share:g} times the delay. All structures meet the same demands.",
        fontsize=7.5, color="0.35", va="top",
    )  # fmt: skip
    return figure


def _draw_panel(axes: Axes, panel: Panel, points: Sequence[Point]) -> None:
    for structure in panel.asked.structures:
        law, alone = STRUCTURES[structure].law, not STRUCTURES[structure].follows_car
        (style,) = law_styles([controller_law(law)])
        mark = "x" if alone else _MARKS.get(structure, "o")
        place = (panel.table.name, structure)
        chosen = [point for point in points if (point.panel, point.structure) == place]
        held = [point for point in chosen if math.isfinite(point.rms_m)]
        axes.plot(
            [point.delay_ms for point in held], [1e3 * point.rms_m for point in held],
            marker=mark, ms=4.5, label=f"{structure}: {STRUCTURES[structure].reads}", **style,
        )  # fmt: skip
        lost = [point.delay_ms for point in chosen if math.isinf(point.rms_m)]
        if lost:
            axes.plot(
                lost, [1.0] * len(lost), "x", ms=7, color=style["color"], clip_on=False,
                transform=axes.get_xaxis_transform(),
            )  # fmt: skip
    axes.set(yscale="log", xlabel="guaranteed delay [ms]")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _place: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.set_title(f"Least error found, {panel.table.name}", fontsize=11)


WORKERS = 2
_PREDICTOR_EFFORT = 12
"""Its search takes as long as that of so many parameters."""


def run_frontier(asked: FrontierSettings, vehicle: VehicleFile, folder: Path) -> None:
    """Compute, write frontier.csv and the pictures, and print the tables.

    The file has what is found after each structure.
    Raises OSError where the folder cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    panels, file = panels_of(asked, vehicle), folder / "frontier.csv"
    jobs = [(panel, name) for panel in panels for name in asked.structures]
    found: dict[tuple[str, str], list[Point]] = {(p.table.name, name): [] for p, name in jobs}
    with worker_pool(WORKERS) as pool, counting_bars(plain_console(is_error=True)) as bars:
        futures = {
            pool.submit(compute, *job): (job[0].table.name, job[1])
            for job in sorted(jobs, key=_effort, reverse=True)
        }
        for future in bars.track(as_completed(futures), total=len(futures)):
            found[futures[future]] = future.result()
            write_csv((point for each in found.values() for point in each), file)
    points = [point for each in found.values() for point in each]
    with plot_style():
        for name, drawn in (("frontier", panels[:1]), ("frontier_at_speed", panels[1:])):
            if drawn:
                figure = draw_frontier(drawn, points)
                figure.savefig(folder / f"{name}.png", bbox_inches="tight")
    for panel in panels:
        for line in _table(panel, points):
            print(line)
    print(f"-> {folder}: frontier.csv and its pictures")


def _effort(job: tuple[Panel, str]) -> int:
    """Return a rough measure of the time that a search takes."""
    panel, name = job
    parameters = len(KEYS.get(STRUCTURES[name].law, ())) * len(STRUCTURES[name].q_kinds)
    return len(panel.table.delays_ms) * (parameters or _PREDICTOR_EFFORT)


def compute(panel: Panel, structure: str) -> list[Point]:
    """Return a structure's points, the shortest delay first."""
    find = predictor_points(panel) if structure == PREDICTOR else designed_points(panel, structure)
    return [*find][::-1]


def write_csv(points: Iterable[Point], file: Path) -> None:
    """Write one line for each structure and delay; lengths in metres, parameters by name."""
    with open_text(file) as stream:
        writer = csv.writer(stream, lineterminator="\n")
        names = [name for name in Point._fields if name != "values"]
        writer.writerow([*names, "values"])
        for point in points:
            values = " ".join(f"{key}={value:g}" for key, value in point.values.items())
            writer.writerow([*(_shown(getattr(point, name)) for name in names), values])


def _shown(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    return "" if value is None else str(value)


def _table(panel: Panel, points: Sequence[Point]) -> Iterator[str]:
    """Yield the car's RMS [mm], a structure a line; a dash where there is no design."""
    delays_ms = panel.table.delays_ms
    for what, figure in (("without", "rms_m"), ("with", "noisy_rms_m")):
        head = f"{panel.table.name}: RMS of the car [mm], {what} noise, at a guaranteed delay of"
        yield head + "".join(f"{ms:>9g}" for ms in delays_ms)
        by_place = {
            (one.panel, one.structure, one.delay_ms): getattr(one, figure) for one in points
        }
        for name in panel.asked.structures:
            found = [by_place.get((panel.table.name, name, ms)) for ms in delays_ms]
            figures = "".join(f"{'-' if m is None else f'{1e3 * m:.3g}':>9}" for m in found)
            reads = STRUCTURES[name].reads
            yield f"  {name:18}{f'reads {reads}':<{len(head) - 20}}{figures}"
