"""The whole frontier, computed in worker processes: tables, a file and pictures."""

import csv
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import as_completed
from pathlib import Path
from typing import Any

from ....closed_loop.processes.parallel_work import worker_pool
from ....closed_loop.reports.plot_style import plot_style
from ....closed_loop.reports.terminal import counting_bars, plain_console
from ....controller.laws.predictor import NAME as PREDICTOR
from ....runtime.output_file import open_text
from ..search.law_parameters import KEYS
from ..vehicle_file import VehicleFile
from .picture import draw_frontier
from .points import Point, designed_points, predictor_points
from .settings import STRUCTURES, FrontierSettings, Panel, panels_of

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
