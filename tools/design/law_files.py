"""Designs one law in a worker process, and writes its files."""

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from ...closed_loop.reports.plot_style import plot_style
from ...controller.laws.law_from_settings import required
from ...controller.settings import ControllerSettings
from ...runtime.output_file import write_text
from .demands import Demand
from .law_design import Design, design, nearest
from .predictor_design import design_predictor, predictor_demands
from .report import (
    STOPPED,
    UNITS,
    draw_design,
    measured,
    outcome_lines,
    predictor_figures,
    preset_text,
    unmet_text,
)
from .search.evolution import ends_after
from .search.law_parameters import SETTINGS_KEYS, controller_settings, with_set_point
from .search.parameter_search import Found
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
    ``text``    of its file
    ``error``   why it is no design; empty if it is one
    ``design``  of a linear law that meets all demands
    ``ended``   whether the search came to its end
    """

    lines: tuple[str, ...]
    demands: tuple[Demand, ...]
    text: str
    error: str = ""
    design: Design | None = None
    ended: bool = True


def run_job(job: Job) -> Outcome:
    """Design a law and write its preset and its picture; what meets not all demands, as unmet."""
    found = _predictor(job) if job.law == PREDICTOR else _linear_law(job)
    name, folder = f"{job.spec.name}_{job.law}", job.preset_folder
    preset, unmet = folder / f"{name}.toml", folder / f"{name}.unmet.toml"
    if found.error:
        write_text(unmet, found.text)
        more = [*outcome_lines(found.demands), f"  no preset; the best so far -> {unmet}"]
        return found._replace(lines=(*found.lines, *more))
    write_text(preset, found.text)
    unmet.unlink(missing_ok=True)
    if found.design is not None:
        with plot_style():
            picture = job.picture_folder / f"{name}.png"
            draw_design(job.spec, job.vehicle, found.design).savefig(picture)
    stopped = [] if found.ended else [f"  {STOPPED}"]
    return found._replace(lines=(*found.lines, *stopped, f"  -> {preset}"))


def _linear_law(job: Job) -> Outcome:
    spec, vehicle, law = job.spec, job.vehicle, job.law
    designed = design(spec, vehicle, law, ends_after(job.minutes))
    if isinstance(designed, Found):
        demands = designed.judgement.demands
        settings = controller_settings(spec, vehicle, law, designed.values)
        text = unmet_text(law, with_set_point(spec, settings), demands, job.sources)
        return Outcome((), demands, text, f"{law}: no design; {nearest(designed)}")
    found = designed.found
    lines = ["", f"{law}  ({found.judged} sets of parameters judged)"]
    lines += [
        f"  {SETTINGS_KEYS[key]} = {value:g} {UNITS.get(key, 'rad/s')}"
        for key, value in found.values.items()
    ]
    demands = found.judgement.demands
    lines += [*outcome_lines(demands), *_table(measured(spec, designed))]
    text = preset_text(spec, vehicle, designed, job.sources)
    return Outcome(tuple(lines), demands, text, design=designed, ended=found.ended)


def _predictor(job: Job) -> Outcome:
    spec, vehicle = job.spec, job.vehicle
    check = ends_after(job.minutes)
    design = design_predictor(spec, vehicle, required(job.fallback), check)
    judged = f"predictor  ({design.judged} sets of parameters judged)"
    lines = ("", judged, *_table(predictor_figures(spec, design)))
    demands = predictor_demands(spec, design)
    if count := sum(demand.excess > 0.0 for demand in demands):
        text = unmet_text(PREDICTOR, design.settings, demands, job.sources)
        error = f"predictor: {count} of {len(demands)} demands are not met"
        return Outcome(lines, demands, text, error)
    text = preset_text(spec, vehicle, design, job.sources)
    return Outcome(lines, demands, text, ended=design.ended)


def _table(figures: Iterable[tuple[str, str]]) -> tuple[str, ...]:
    return tuple(f"  {label:18}{text}" for label, text in figures)
