"""The whole frontier, computed in worker processes: a table, a file and two pictures."""

import csv
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from ....closed_loop.processes.parallel_work import worker_pool
from ....closed_loop.reports.plot_style import plot_style
from ....controller.settings import controller_preset
from ....runtime.exit_status import ExitStatus
from ....runtime.output_file import open_text
from ..search.law_parameters import KEYS, controller_settings
from ..searches import Searches, begin_worker, report_from
from ..vehicle_file import VehicleFile
from .picture import draw_frontier, draw_trials
from .points import (
    PREDICTOR,
    PREDICTOR_PRESET,
    PUBLISHED,
    Point,
    Row,
    designed_points,
    predictor_points,
    published_points,
    specification_for,
)
from .settings import STRUCTURES, FrontierSettings
from .trials import NOT_TRIED, Trials, try_out, with_map

ALL = (*STRUCTURES, PREDICTOR, PUBLISHED)
WORKERS = 2


def run_frontier(
    program: str, asked: FrontierSettings, vehicle: VehicleFile, folder: Path
) -> ExitStatus:
    """Compute, write frontier.csv and both pictures, and print the table.

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
    rows = [row for future in done for row in future.result()]
    write_csv(rows, folder / "frontier.csv")
    with plot_style():
        draw_frontier(asked, rows).savefig(folder / "frontier.png", bbox_inches="tight")
        draw_trials(rows).savefig(folder / "frontier_trials.png")
    for line in _table(asked, rows):
        print(line)
    print(f"-> {folder}: frontier.csv, frontier.png, frontier_trials.png")
    return ExitStatus.INTERRUPTED if searches.is_stopped else ExitStatus.OK


def _effort(structure: str) -> int:
    """Return a rough measure of the time that a search takes."""
    if structure not in STRUCTURES:
        return 0
    law, _, q_kinds = STRUCTURES[structure]
    return len(KEYS[law]) * len(q_kinds)


def compute(asked: FrontierSettings, vehicle: VehicleFile, structure: str) -> list[Row]:
    """Return a structure's rows, the shortest delay first."""
    if structure == PUBLISHED:
        return [Row(point, NOT_TRIED) for point in published_points(asked, vehicle)]
    if structure == PREDICTOR:
        settings = controller_preset(PREDICTOR_PRESET)
        return [
            Row(point, try_out(asked, vehicle, settings, point.delay_ms))
            for point in predictor_points(asked, vehicle)
        ][::-1]
    report = report_from(ALL.index(structure))
    law, takes_map, _ = STRUCTURES[structure]
    rows = []
    for point in designed_points(asked, vehicle, structure, lambda share: report(share, 0.0)):
        spec = specification_for(asked, law, point.delay_ms, point.q_kind or "type_2")
        settings = with_map(controller_settings(spec, vehicle, law, point.values), takes_map)
        rows.append(Row(point, try_out(asked, vehicle, settings, point.delay_ms)))
    return rows[::-1]


def write_csv(rows: Iterable[Row], file: Path) -> None:
    """Write one line for each structure and delay; lengths in metres, parameters by name."""
    with open_text(file) as stream:
        writer = csv.writer(stream, lineterminator="\n")
        names = [name for name in Point._fields if name != "values"]
        writer.writerow([*names, *Trials._fields, "values"])
        for point, trials in rows:
            values = " ".join(f"{key}={value:g}" for key, value in point.values.items())
            figures = [getattr(point, name) for name in names]
            writer.writerow([*map(_shown, (*figures, *trials)), values])


def _shown(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.6g}"
    return "" if value is None else str(value)


def _table(asked: FrontierSettings, rows: Sequence[Row]) -> Iterator[str]:
    """Yield RMS errors [mm], a structure a line; a dash where there is no design."""
    yield "RMS [mm] at a guaranteed delay of" + "".join(f"{ms:>9g}" for ms in asked.delays_ms)
    by_place = {(point.structure, point.delay_ms): f"{1e3 * point.rms_m:.3g}" for point, _ in rows}
    for name in ALL[:-1]:
        figures = "".join(f"{by_place.get((name, ms), '-'):>9}" for ms in asked.delays_ms)
        yield f"  {name:31}{figures}"
    for point, _ in rows:
        if point.structure.startswith(PUBLISHED):
            found = f"{1e3 * point.rms_m:.3g} mm at {point.delay_ms:.3g} ms"
            yield f"  {point.structure:48}{found if point.delay_ms else 'drifts off'}"
