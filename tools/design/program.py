"""Program ``steer-by-wire design``: designs the laws of a specification, or a frontier."""

import argparse
import sys
import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from ...closed_loop.processes.parallel_work import worker_pool
from ...closed_loop.reports.plot_style import plot_style
from ...closed_loop.reports.terminal import counting_bars, plain_console
from ...controller.laws.law_from_settings import required
from ...controller.laws.predictor import FALLBACK
from ...controller.settings import ControllerSettings, controller_preset
from ...runtime.command_line import say
from ...runtime.exit_status import ExitStatus
from ...runtime.output_file import write_text
from ...runtime.program.output_folder import refuse_another_run
from ...runtime.program.report import write_json
from ...runtime.settings import SettingsError, load_settings
from ...runtime.settings.toml_text import dump_toml
from .demands import Demand
from .frontier.frontier import run_frontier
from .frontier.settings import FrontierSettings
from .law_design import design, nearest
from .predictor_design import design_predictor, plan_ahead, predictor_demands
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
from .road import on_road
from .search.law_parameters import KEYS, SETTINGS_KEYS, controller_settings, with_set_point
from .search.parameter_search import Found
from .specification import Specification
from .vehicle_file import VehicleFile, load_vehicle
from .virtual_check import course_line, plant_text, refuse_what_the_plant_does_not_drive

PREDICTOR, PACKET = "predictor", "packet"


class Job(NamedTuple):
    """A law to be designed.

    ``sources``   names of the files of vehicle and specification
    ``minutes``   after which the search ends with its best so far
    ``basis``     the pd_ddob that a predictor falls back to, or the predictor of a packet
    ``basis_ended``  whether the search for that predictor came to its end
    """

    spec: Specification
    vehicle: VehicleFile
    law: str
    sources: tuple[str, str]
    preset_folder: Path
    picture_folder: Path
    minutes: float
    basis: ControllerSettings | None = None
    basis_ended: bool = True

    def ends_at_s(self) -> float:
        """Return when a search that begins now ends, by the monotonic clock."""
        return time.monotonic() + 60.0 * self.minutes


class Outcome(NamedTuple):
    """What became of a law.

    ``lines``   to print
    ``text``    of its file
    ``error``   why it is no design; empty if it is one
    ``preset``  of a law that meets all demands
    ``ended``   whether the search came to its end
    """

    lines: tuple[str, ...]
    demands: tuple[Demand, ...]
    text: str
    error: str = ""
    preset: ControllerSettings | None = None
    ended: bool = True


def run_job(job: Job) -> Outcome:
    """Design a law and write its preset and its picture; what meets not all demands, as unmet."""
    found = _linear_law(job) if job.law in KEYS else _predictor(job)
    name, folder = f"{job.spec.name}_{job.law}", job.preset_folder
    preset, unmet = folder / f"{name}.toml", folder / f"{name}.unmet.toml"
    if found.error:
        write_text(unmet, found.text)
        more = [*outcome_lines(found.demands), f"  no preset; the best so far -> {unmet}"]
        return found._replace(lines=(*found.lines, *more))
    write_text(preset, found.text)
    unmet.unlink(missing_ok=True)
    stopped = [] if found.ended else [f"  {STOPPED}"]
    return found._replace(lines=(*found.lines, *stopped, f"  -> {preset}"))


def _linear_law(job: Job) -> Outcome:
    spec, vehicle, law = job.spec, job.vehicle, job.law
    designed = design(spec, vehicle, law, job.ends_at_s())
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
    with plot_style():
        picture = job.picture_folder / f"{spec.name}_{law}.png"
        draw_design(spec, vehicle, designed).savefig(picture)
    text = preset_text(spec, vehicle, designed, job.sources)
    return Outcome(tuple(lines), demands, text, preset=designed.preset, ended=found.ended)


def _predictor(job: Job) -> Outcome:
    spec, vehicle, law, basis = job.spec, job.vehicle, job.law, required(job.basis)
    if law == PREDICTOR:
        design = design_predictor(spec, vehicle, basis, job.ends_at_s())
    elif basis.estimator.actuator_dead_time_s:
        error = f"{law}: no design; a plan cannot allow for the dead time of the steering"
        return Outcome((), (), unmet_text(law, basis, (), job.sources), error)
    else:
        design = plan_ahead(spec, vehicle, basis)._replace(ended=job.basis_ended)
    judged = f"{law}  ({design.judged} sets of parameters judged)"
    lines = ("", judged, *_table(predictor_figures(spec, design)))
    demands = predictor_demands(spec, design)
    if count := sum(demand.excess > 0.0 for demand in demands):
        text = unmet_text(law, design.settings, demands, job.sources)
        error = f"{law}: {count} of {len(demands)} demands are not met"
        return Outcome(lines, demands, text, error)
    text = preset_text(spec, vehicle, design, job.sources)
    return Outcome(lines, demands, text, preset=design.settings, ended=design.ended)


def _table(figures: Iterable[tuple[str, str]]) -> tuple[str, ...]:
    return tuple(f"  {label:18}{text}" for label, text in figures)


NAME = "steer-by-wire design"
NO_DESIGN = 1
WORKERS = 2


def run_design(options: argparse.Namespace) -> int:
    """Design what was asked for; returns the exit status."""
    begin_s = time.perf_counter()
    vehicle = load_vehicle(options.vehicle)
    if options.frontier is not None:
        if options.json is not None:
            raise SettingsError("--json: --frontier writes frontier.csv")
        asked = load_settings(FrontierSettings, None, options.frontier, options.overrides)
        run_frontier(asked, vehicle, options.out)
        print(f"{time.perf_counter() - begin_s:.0f} s")
        return ExitStatus.OK
    spec = load_settings(Specification, None, options.spec, options.overrides)
    vehicle = vehicle if spec.road is None else on_road(spec.road, vehicle)
    refuse_what_the_plant_does_not_drive(spec, vehicle)
    course = course_line(spec, vehicle)
    pictures = options.pictures or options.out
    rig = _write_settings(spec, vehicle, options.out, pictures)
    if linear_laws(spec) or spec.road is None:
        print(
            f"{len(vehicle.corners)} corners x {len(spec.delays_ns)} delays from 0 to"
            f" {spec.delay.ms_max:g} ms at {spec.rate_hz:g} Hz; minimised is the worst rms"
        )
    print(course)
    laws = [*linear_laws(spec), *(law for law in (PREDICTOR, PACKET) if law in spec.laws)]
    sources = (options.vehicle.name, options.spec.name)
    jobs = {
        law: Job(spec, vehicle, law, sources, options.out, pictures, options.minutes)
        for law in laws
    }
    status, figures = int(ExitStatus.OK), dict[str, Any]()
    named = spec.predictor and spec.predictor.fallback
    basis, basis_ended = controller_preset(named) if named else None, True
    needed = "pd_ddob for it to fall back to"
    bars = counting_bars(plain_console(is_error=True))
    with worker_pool(WORKERS) as pool, bars:
        searched = bars.add_task("", total=len(laws))
        futures = {law: pool.submit(run_job, jobs[law]) for law in linear_laws(spec)}
        for law in laws:
            if law in futures:
                outcome = futures[law].result()
                bars.advance(searched)
            elif basis is None:
                say(NAME, f"error: {law}: there is no {needed}", sys.stderr)
                status = NO_DESIGN
                continue
            else:
                job = jobs[law]._replace(basis=basis, basis_ended=basis_ended)
                outcome = pool.submit(run_job, job).result()
            figures[law] = _print(outcome)
            status = NO_DESIGN if outcome.error else status
            if law == FALLBACK:
                basis = basis or outcome.preset
            elif law == PREDICTOR:
                basis, basis_ended = outcome.preset, outcome.ended
                needed = "predictor whose commands it plans"
    if options.json is not None:
        write_json(options.json, {"specification": spec.model_dump(mode="json"), "laws": figures})
    print(f"\nplant for these: {rig}")
    print(f"{time.perf_counter() - begin_s:.0f} s")
    return status


def linear_laws(spec: Specification) -> list[str]:
    """Return the laws that are designed by the linear analysis."""
    heading = {"pid": "pid_heading"} if spec.pid_heading_gain else {}
    return [heading.get(law, law) for law in spec.laws if law in KEYS]


def _write_settings(spec: Specification, vehicle: VehicleFile, out: Path, pictures: Path) -> Path:
    """Write the plant that the designs are for, and their specification; returns the former."""
    rig, asked_for = (pictures / f"{spec.name}_{what}.toml" for what in ("plant", "specification"))
    texts = {
        rig.name: plant_text(spec, vehicle),
        asked_for.name: dump_toml(spec.model_copy(update={"laws": ()})),  # one after the other
    }
    refuse_another_run(pictures, texts)
    for folder in (out, pictures):
        folder.mkdir(parents=True, exist_ok=True)
    for name, text in texts.items():
        write_text(pictures / name, text)
    return rig


def _print(outcome: Outcome) -> Mapping[str, Any]:
    """Print what became of a law; returns its figures, ready for JSON."""
    if outcome.error:
        say(NAME, f"error: {outcome.error}", sys.stderr)
    for line in outcome.lines:
        print(line)
    demands = [demand._asdict() for demand in outcome.demands]
    return {"is_met": not outcome.error, "demands": demands}
