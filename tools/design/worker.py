"""What runs in a worker process: one law from search to files."""

import ctypes
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

from ...closed_loop.reports.plot_style import plot_style
from .law_design import Design, NoDesignError, design
from .law_parameters import controller_settings
from .report import UNMET, draw_design, preset_name, preset_text, unmet_text
from .specification import Specification
from .vehicle_file import VehicleFile

SharedProgress = Any
"""For each law how much of its search is done, and its best cost: an array of 2 n numbers."""

_PROGRESS: list[SharedProgress] = []


class Job(NamedTuple):
    """A law to be designed; ``sources`` are the names of the files of vehicle and specification."""

    spec: Specification
    vehicle: VehicleFile
    law: str
    sources: tuple[str, str]
    preset_folder: Path
    picture_folder: Path
    place: int


def shared_progress(laws: int) -> SharedProgress:
    """Return the memory in which workers report their progress."""
    shared: SharedProgress = get_context("spawn").Array(ctypes.c_double, 2 * laws, lock=False)
    return shared


def begin_worker(progress: SharedProgress) -> None:
    """Keep the memory of the progress."""
    _PROGRESS[:] = [progress]


def run_job(job: Job) -> Design:
    """Design a law and write its preset and its picture; what meets not all demands, as unmet."""
    name = preset_name(job.spec, job.law)
    unmet = job.preset_folder / f"{name}{UNMET}.toml"
    try:
        found = design(job.spec, job.vehicle, job.law, partial(report_progress, job.place))
    except NoDesignError as error:
        if error.found is not None:
            candidate, demands = error.found.candidate, error.found.judgement.demands
            settings = controller_settings(job.spec, job.vehicle, job.law, candidate.values())
            text = unmet_text(job.law, settings, demands, job.sources)
            unmet.write_text(text, encoding="utf-8")
        raise
    unmet.unlink(missing_ok=True)
    text = preset_text(job.spec, job.vehicle, found, job.sources)
    (job.preset_folder / f"{name}.toml").write_text(text, encoding="utf-8")
    with plot_style():
        draw_design(job.spec, job.vehicle, found).savefig(job.picture_folder / f"{name}.png")
    return found


def report_progress(index: int, done: float, best: float) -> None:
    """Write how much of a job is done, and its best cost."""
    for progress in _PROGRESS:
        progress[2 * index : 2 * index + 2] = done, best
