"""What runs in a worker process: one law from search to files."""

import ctypes
import math
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

from ...closed_loop.reports.plot_style import plot_style
from .law_design import Design, NoDesignError, design
from .report import LawFiles, draw_design, preset_name, preset_text, unmet_text
from .search.law_parameters import controller_settings
from .search.stop_and_resume import SearchStoppedError, kept_costs, stopped_after
from .specification import Specification
from .vehicle_file import VehicleFile

SharedProgress = Any
"""For each law how much of its search is done, and its best cost; then whether to stop: an array of
2 n + 1 numbers."""

_PROGRESS: list[SharedProgress] = []


class Job(NamedTuple):
    """A law to be designed; ``sources`` are the names of the files of vehicle and specification.

    ``minutes``  after which the search ends with its best so far
    """

    spec: Specification
    vehicle: VehicleFile
    law: str
    sources: tuple[str, str]
    preset_folder: Path
    picture_folder: Path
    place: int
    minutes: float


def shared_progress(laws: int) -> SharedProgress:
    """Return the memory in which workers report their progress."""
    shared: SharedProgress = get_context("spawn").Array(ctypes.c_double, 2 * laws + 1, lock=False)
    return shared


def begin_worker(progress: SharedProgress) -> None:
    """Keep the memory of the progress."""
    _PROGRESS[:] = [progress]


def run_job(job: Job) -> Design:
    """Design a law and write its preset and its picture; what meets not all demands, as unmet."""
    files = LawFiles(job.preset_folder, preset_name(job.spec, job.law))
    kept = kept_costs(files.search, job.spec, job.vehicle, job.law)
    show = partial(report_progress, job.place)
    show(0.0, math.inf)
    progress = stopped_after(job.minutes, show)
    try:
        found = design(job.spec, job.vehicle, job.law, progress, kept)
    except NoDesignError as error:
        if error.found is not None:
            candidate, demands = error.found.candidate, error.found.judgement.demands
            settings = controller_settings(job.spec, job.vehicle, job.law, candidate.values())
            files.write_unmet(unmet_text(job.law, settings, demands, job.sources))
        if error.found is None or error.found.ended:
            kept.forget()
        raise
    files.write_preset(preset_text(job.spec, job.vehicle, found, job.sources))
    if found.found.ended:
        kept.forget()
    with plot_style():
        draw_design(job.spec, job.vehicle, found).savefig(job.picture_folder / f"{files.name}.png")
    return found


def report_progress(index: int, done: float, best: float) -> None:
    """Write how much of a job is done, and its best cost; raises SearchStoppedError."""
    for progress in _PROGRESS:
        progress[2 * index : 2 * index + 2] = done, best
        if progress[-1]:
            raise SearchStoppedError
