"""The whole frontier, computed in worker processes: a table, a file and a picture."""

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
from .settings import STRUCTURES, FrontierSettings

WORKERS = 2


def run_frontier(asked: FrontierSettings, vehicle: VehicleFile, folder: Path) -> None:
    """Compute, write frontier.csv and frontier.png, and print the table.

    Raises OSError where the folder cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with worker_pool(WORKERS) as pool, counting_bars(plain_console(is_error=True)) as bars:
        futures = {
            name: pool.submit(compute, asked, vehicle, name)
            for name in sorted(asked.structures, key=_effort, reverse=True)
        }
        for _ in bars.track(as_completed(futures.values()), total=len(futures)):
            pass
    points = [point for name in asked.structures for point in futures[name].result()]
    write_csv(points, folder / "frontier.csv")
    with plot_style():
        draw_frontier(asked, points).savefig(folder / "frontier.png", bbox_inches="tight")
    for line in _table(asked, points):
        print(line)
    print(f"-> {folder}: frontier.csv, frontier.png")


def _effort(structure: str) -> int:
    """Return a rough measure of the time that a search takes."""
    law, q_kinds = STRUCTURES[structure].law, STRUCTURES[structure].q_kinds
    return len(KEYS.get(law, ())) * len(q_kinds)


def compute(asked: FrontierSettings, vehicle: VehicleFile, structure: str) -> list[Point]:
    """Return a structure's points, the shortest delay first."""
    if structure == PREDICTOR:
        points = predictor_points(asked, vehicle)
    else:
        points = designed_points(asked, vehicle, structure)
    return [*points][::-1]


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


def _table(asked: FrontierSettings, points: Sequence[Point]) -> Iterator[str]:
    """Yield the car's RMS [mm], a structure a line; a dash where there is no design."""
    for what, figure in (("without", "rms_m"), ("with", "noisy_rms_m")):
        head = f"RMS of the car [mm], {what} noise, at a guaranteed delay of"
        yield head + "".join(f"{ms:>9g}" for ms in asked.delays_ms)
        by_place = {(one.structure, one.delay_ms): getattr(one, figure) for one in points}
        for name in asked.structures:
            found = [by_place.get((name, ms)) for ms in asked.delays_ms]
            figures = "".join(f"{'-' if m is None else f'{1e3 * m:.3g}':>9}" for m in found)
            reads = STRUCTURES[name].reads
            yield f"  {name:18}{f'reads {reads}':<{len(head) - 20}}{figures}"
