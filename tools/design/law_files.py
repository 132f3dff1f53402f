"""Designs one law in a worker process, and writes its files."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from ...closed_loop.reports.plot_style import plot_style
from ...controller.laws.law_from_settings import required
from ...controller.settings import ControllerSettings
from ...runtime.output_file import write_text
from .demands import Demand
from .law_design import Design, NoDesignError, design
from .predictor_design import design_predictor, predictor_demands
from .report import (
    UNITS,
    LawFiles,
    draw_design,
    measured,
    outcome_lines,
    predictor_figures,
    predictor_preset_text,
    preset_text,
    unmet_lines,
    unmet_text,
    written_lines,
)
from .search.evolution import ends_after
from .search.law_parameters import SETTINGS_KEYS, controller_settings, with_set_point
from .specification import Specification
from .vehicle_file import VehicleFile

PREDICTOR = "predictor"


class Job(NamedTuple):
    """A law to be designed.

    ``sources``   names of the files of vehicle and specification
    ``minutes``   after which the search ends with its best so far
    ``fallback``  the pd_ddob that a predictor falls back to
    """

    spec: Specification
    vehicle: VehicleFile
    law: str
    sources: tuple[str, str]
    preset_folder: Path
    picture_folder: Path
    minutes: float
    fallback: ControllerSettings | None = None


class Outcome(NamedTuple):
    """What became of a law.

    ``lines``   to print
    ``error``   why it is no design; empty if it is one
    ``design``  of a linear law that meets all demands
    """

    lines: tuple[str, ...]
    demands: tuple[Demand, ...]
    error: str = ""
    design: Design | None = None


def run_job(job: Job) -> Outcome:
    """Design a law and write its preset and its picture; what meets not all demands, as unmet."""
    name, folder = f"{job.spec.name}_{job.law}", job.preset_folder
    files = LawFiles(folder / f"{name}.toml", folder / f"{name}.unmet.toml")
    return _predictor(job, files) if job.law == PREDICTOR else _linear_law(job, files)


def _linear_law(job: Job, files: LawFiles) -> Outcome:
    spec, vehicle, law = job.spec, job.vehicle, job.law
    try:
        designed = design(spec, vehicle, law, ends_after(job.minutes))
    except NoDesignError as error:
        demands = error.found.judgement.demands
        settings = controller_settings(spec, vehicle, law, error.found.values)
        settings = with_set_point(spec, settings)
        write_text(files.unmet, unmet_text(law, settings, demands, job.sources))
        return Outcome(tuple(unmet_lines(demands, files)), demands, str(error))
    files.write_preset(preset_text(spec, vehicle, designed, job.sources))
    with plot_style():
        picture = job.picture_folder / f"{files.preset.stem}.png"
        draw_design(spec, vehicle, designed).savefig(picture)
    lines = tuple(_lines(spec, designed, files))
    return Outcome(lines, designed.found.judgement.demands, design=designed)


def _lines(spec: Specification, design: Design, files: LawFiles) -> Iterator[str]:
    yield ""
    yield f"{design.law}  ({design.found.judged} sets of parameters judged)"
    values = design.found.values.items()
    yield from (
        f"  {SETTINGS_KEYS[key]} = {value:g} {UNITS.get(key, 'rad/s')}" for key, value in values
    )
    yield from outcome_lines(design.found.judgement.demands)
    yield from (f"  {label:18}{text}" for label, text in measured(spec, design))
    yield from written_lines(files, design.found.ended)


def _predictor(job: Job, files: LawFiles) -> Outcome:
    spec, table, vehicle = job.spec, required(job.spec.predictor), job.vehicle
    check = ends_after(job.minutes)
    design = design_predictor(spec, table, vehicle, required(job.fallback), check)
    lines = ["", f"predictor  ({design.judged} sets of parameters judged)"]
    figures = predictor_figures(spec, table, design)
    lines += [f"  {label:18}{text}" for label, text in figures]
    demands = predictor_demands(spec, table, design)
    count = sum(demand.excess > 0.0 for demand in demands)
    if count:
        write_text(files.unmet, unmet_text(PREDICTOR, design.settings, demands, job.sources))
        lines += unmet_lines(demands, files)
        error = f"predictor: {count} of {len(demands)} demands are not met"
        return Outcome(tuple(lines), demands, error)
    files.write_preset(predictor_preset_text(spec, table, vehicle, design, job.sources))
    return Outcome((*lines, *written_lines(files, design.ended)), demands)
