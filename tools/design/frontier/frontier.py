"""The whole frontier, computed in worker processes: a table, a file and a picture."""

import csv
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from ....closed_loop.processes.parallel_work import worker_pool
from ....closed_loop.reports.plot_style import plot_style
from ....runtime.exit_status import ExitStatus
from ....runtime.output_file import open_text
from ..search.law_parameters import KEYS
from ..searches import Searches, begin_worker, report_from
from ..vehicle_file import VehicleFile
from .picture import draw_frontier
from .points import PREDICTOR, Point, designed_points, predictor_points
from .settings import STRUCTURES, FrontierSettings

ALL = (*STRUCTURES, PREDICTOR)
WORKERS = 2


def run_frontier(
    program: str, asked: FrontierSettings, vehicle: VehicleFile, folder: Path
) -> ExitStatus:
    """Compute, write frontier.csv and frontier.png, and print the table.

    Ctrl-C ends it with what is done. Raises OSError where the folder cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    searches = Searches(program, ALL)
    with (
        worker_pool(WORKERS, begin_worker, searches.shared) as pool,
        searches.stopped_by_ctrl_c(),
    ):
        futures = {
            name: pool.submit(compute, asked, vehicle, name)
            for name in sorted(ALL, key=_effort, reverse=True)
        }
        searches.watch(futures)
    done = [futures[name] for name in ALL if not futures[name].cancelled()]
    points = [point for future in done for point in future.result()]
    write_csv(points, folder / "frontier.csv")
    with plot_style():
        draw_frontier(asked, points).savefig(folder / "frontier.png", bbox_inches="tight")
    for line in _table(asked, points):
        print(line)
    print(f"-> {folder}: frontier.csv, frontier.png")
    return ExitStatus.INTERRUPTED if searches.is_stopped else ExitStatus.OK


def _effort(structure: str) -> int:
    """Return a rough measure of the time that a search takes."""
    if structure not in STRUCTURES:
        return 0
    law, _, q_kinds = STRUCTURES[structure]
    return len(KEYS[law]) * len(q_kinds)


def compute(asked: FrontierSettings, vehicle: VehicleFile, structure: str) -> list[Point]:
    """Return a structure's points, the shortest delay first."""
    if structure == PREDICTOR:
        points = predictor_points(asked, vehicle)
    else:
        report = report_from(ALL.index(structure))
        points = designed_points(asked, vehicle, structure, lambda share: report(share, 0.0))
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
    """Yield RMS errors [mm], a structure a line; a dash where there is no design."""
    yield "RMS [mm] at a guaranteed delay of" + "".join(f"{ms:>9g}" for ms in asked.delays_ms)
    by_place = {(point.structure, point.delay_ms): f"{1e3 * point.rms_m:.3g}" for point in points}
    for name in ALL:
        figures = "".join(f"{by_place.get((name, ms), '-'):>9}" for ms in asked.delays_ms)
        yield f"  {name:31}{figures}"
