"""Runs the frontier in worker processes, shows how far each structure is, and leaves its files."""

from collections.abc import Iterator, Sequence
from concurrent.futures import Future, wait
from pathlib import Path
from typing import NamedTuple

from rich.progress import BarColumn, TextColumn, TimeElapsedColumn

from ....closed_loop.processes.parallel_work import worker_pool
from ....closed_loop.reports.plot_style import plot_style
from ....closed_loop.reports.terminal import plain_console, progress_bars
from ..search.law_parameters import KEYS
from ..vehicle_file import VehicleFile
from ..worker import begin_worker, report_progress, shared_progress
from .frontier import ALL, Row, compute, write_csv
from .laws_of_the_paper import PUBLISHED
from .picture import draw_frontier, draw_trials
from .settings import STRUCTURES, FrontierSettings

WORKERS = 2
_POLL_S = 0.2


class Job(NamedTuple):
    """One structure, computed in a worker."""

    asked: FrontierSettings
    vehicle: VehicleFile
    structure: str
    folder: Path
    place: int


def run_job(job: Job) -> list[Row]:
    """Compute one structure."""

    def done(share: float) -> None:
        report_progress(job.place, share, 0.0)

    return compute(job.asked, job.vehicle, job.structure, job.folder, done)


def _effort(job: Job) -> int:
    """Return a rough measure of the time that a search takes."""
    if job.structure not in STRUCTURES:
        return 0
    law, _, q_kinds = STRUCTURES[job.structure]
    return len(KEYS[law]) * len(q_kinds)


def run_frontier(asked: FrontierSettings, vehicle: VehicleFile, folder: Path) -> list[str]:
    """Compute, write frontier.csv and both pictures; returns the lines of the table.

    Raises OSError where the folder cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    progress = shared_progress(len(ALL))
    with worker_pool(WORKERS, begin_worker, progress) as pool:
        jobs = [Job(asked, vehicle, name, folder, place) for place, name in enumerate(ALL)]
        dearest_first = sorted(jobs, key=_effort, reverse=True)
        by_place = {job.place: pool.submit(run_job, job) for job in dearest_first}
        futures = [by_place[job.place] for job in jobs]
        _watch(futures, progress)
        rows = [row for future in futures for row in future.result()]
    write_csv(rows, folder / "frontier.csv")
    with plot_style():
        draw_frontier(asked, rows).savefig(folder / "frontier.png", bbox_inches="tight")
        draw_trials(asked, rows).savefig(folder / "frontier_trials.png")
    return list(_table(asked, rows))


def _watch(futures: Sequence[Future[list[Row]]], shared: Sequence[float]) -> None:
    columns = TextColumn("{task.description:10}"), BarColumn(30), TimeElapsedColumn()
    with progress_bars(plain_console(), *columns) as bars:
        tasks = [bars.add_task(name, total=1.0) for name in ALL]
        waiting: set[Future[list[Row]]] = set(futures)
        while waiting:
            _, waiting = wait(waiting, timeout=_POLL_S)
            for place, (task, future) in enumerate(zip(tasks, futures, strict=True)):
                bars.update(task, completed=1.0 if future.done() else shared[2 * place])


def _table(asked: FrontierSettings, rows: Sequence[Row]) -> Iterator[str]:
    """Yield RMS errors [mm], a structure a line; a dash where there is no design."""
    yield "RMS [mm] at a guaranteed delay of" + "".join(f"{ms:>9g}" for ms in asked.delays_ms)
    for name in ALL:
        by_delay = {
            row.point.delay_ms: f"{1e3 * row.point.rms_m:.3g}"
            for row in rows
            if row.point.structure == name
        }
        figures = "".join(f"{by_delay.get(ms, '-'):>9}" for ms in asked.delays_ms)
        if name != PUBLISHED:
            yield f"  {name:31}{figures}"
    for point, _ in rows:
        if point.structure.startswith(PUBLISHED):
            found = f"{1e3 * point.rms_m:.3g} mm at {point.delay_ms:.3g} ms"
            yield f"  {point.structure:48}{found if point.delay_ms else 'drifts off'}"
