"""Designs the laws of a specification, or a frontier; prints why each value is what it is."""

import argparse
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError, Future, wait
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from ...closed_loop.processes.parallel_work import worker_pool
from ...closed_loop.reports.terminal import plain_console, progress_bars
from ...controller.laws.predictor import FALLBACK
from ...controller.settings import ControllerSettings, controller_preset
from ...runtime.command_line import ending_signals, say
from ...runtime.exit_status import ExitStatus
from ...runtime.output_file import write_text
from ...runtime.program.output_folder import refuse_another_run
from ...runtime.program.report import write_json
from ...runtime.settings import SettingsError, load_settings
from ...runtime.settings.toml_text import dump_toml
from .demands import Demand
from .frontier.program import run_frontier
from .frontier.settings import FrontierSettings
from .law_design import Design, NoDesignError
from .predictor_design import design_predictor, predictor_demands
from .progress_lines import ProgressLines
from .report import (
    LawFiles,
    demand_lines,
    predictor_figures,
    predictor_preset_text,
    preset_name,
    reason_lines,
    unmet_lines,
    unmet_text,
    written_lines,
)
from .search.law_parameters import KEYS, any_settings
from .search.stop_and_resume import CtrlC, SearchStoppedError, kept_costs, stopped_after
from .specification import PredictorTable, Specification
from .vehicle_file import VehicleFile
from .virtual_check import (
    course_line,
    plant_text,
    refuse_what_the_plant_does_not_drive,
    verification_line,
    verify,
)
from .worker import Job, SharedProgress, begin_worker, run_job, shared_progress

NAME = "steer-by-wire design"
NO_DESIGN = 1
WORKERS = 2
_POLL_S = 0.2


def run_design(options: argparse.Namespace) -> int:
    """Design what was asked for; returns the exit status."""
    begin_s = time.perf_counter()
    vehicle = load_settings(VehicleFile, None, options.vehicle)
    if options.frontier is not None:
        if options.json is not None:
            raise SettingsError("--json: --frontier writes frontier.csv")
        asked = load_settings(FrontierSettings, None, options.frontier, options.overrides)
        for line in run_frontier(asked, vehicle, options.out):
            print(line)
        print(f"-> {options.out}: frontier.csv, frontier.png, frontier_trials.png")
        print(f"{time.perf_counter() - begin_s:.0f} s")
        return int(ExitStatus.OK)
    spec = load_settings(Specification, None, options.spec, options.overrides)
    refuse_what_the_plant_does_not_drive(spec, vehicle, any_settings(spec, vehicle))
    course = course_line(spec, vehicle)
    pictures = options.pictures or options.out
    rig, asked_for = (pictures / f"{spec.name}_{what}.toml" for what in ("plant", "specification"))
    texts = {
        rig.name: plant_text(spec, vehicle, any_settings(spec, vehicle)),
        asked_for.name: dump_toml(spec.model_copy(update={"laws": ()})),  # one after the other
    }
    refuse_another_run(pictures, texts)
    for folder in (options.out, pictures):
        folder.mkdir(parents=True, exist_ok=True)
    for name, text in texts.items():
        write_text(pictures / name, text)
    sources = (options.vehicle.name, options.spec.name)
    jobs = [
        Job(spec, vehicle, law, sources, options.out, pictures, index, options.minutes)
        for index, law in enumerate(linear_laws(spec))
    ]
    console = plain_console()
    print(
        f"{len(vehicle.box.vertices())} corners x {len(spec.delays_ns)} delays from 0 to"
        f" {spec.delay.ms_max:g} ms at {spec.rate_hz:g} Hz; minimised is the worst"
        f" {spec.minimise.replace('_', ' ')}"
    )
    print(course)
    status, figures = int(ExitStatus.OK), dict[str, Any]()
    fallback: ControllerSettings | None = None
    progress, ctrl_c = shared_progress(len(jobs)), CtrlC(NAME)
    workers = max(1, min(WORKERS, len(jobs))) if not options.verify else WORKERS
    with worker_pool(workers, begin_worker, progress) as pool:
        futures = [pool.submit(run_job, job) for job in jobs]
        with ending_signals(ctrl_c):
            _watch(console, linear_laws(spec), futures, progress, options.minutes, ctrl_c)
        for job, future in zip(jobs, futures, strict=True):
            files = LawFiles(options.out, preset_name(spec, job.law))
            try:
                design = future.result()
            except (CancelledError, SearchStoppedError):
                say(NAME, f"{job.law}: not begun", sys.stderr)
                continue
            except NoDesignError as error:
                say(NAME, f"error: {error}", sys.stderr)
                if error.found is not None:
                    figures[job.law] = _figures(error.found.judgement.demands, is_met=False)
                    for line in unmet_lines(error.found.judgement.demands, files):
                        print(line)
                status = NO_DESIGN
                continue
            figures[job.law] = _figures(design.found.judgement.demands, is_met=True)
            for line in _lines(spec, design, options.out):
                print(line)
            if options.verify and not ctrl_c.is_pressed:
                verification = verify(pool, spec, vehicle, design)
                print(verification_line(spec, design, verification))
                status = status if verification.held else NO_DESIGN
            if design.law == FALLBACK:
                fallback = design.settings
    if "predictor" in spec.laws and spec.predictor is not None and not ctrl_c.is_pressed:
        designed = (spec, spec.predictor, vehicle, fallback)
        with ending_signals(ctrl_c):
            found = _design_predictor(console, *designed, sources, options, ctrl_c)
            figures |= {} if found is None else {"predictor": found}
            status = max(status, int(ExitStatus.OK) if found and found["is_met"] else NO_DESIGN)
    if options.json is not None:
        write_json(options.json, {"specification": spec.model_dump(mode="json"), "laws": figures})
    if ctrl_c.is_pressed:
        return int(ExitStatus.INTERRUPTED)
    print(f"\nplant for these: {rig}")
    print(f"{time.perf_counter() - begin_s:.0f} s")
    return status


def linear_laws(spec: Specification) -> list[str]:
    """Return the laws that are designed by the linear analysis."""
    heading = {"pid": "pid_heading"} if spec.pid_heading_gain else {}
    return [heading.get(law, law) for law in spec.laws if law in KEYS]


def _design_predictor(
    console: Console,
    spec: Specification,
    table: PredictorTable,
    vehicle: VehicleFile,
    fallback: ControllerSettings | None,
    sources: tuple[str, str],
    options: argparse.Namespace,
    ctrl_c: CtrlC,
) -> Mapping[str, Any] | None:
    """Design the predictor and print it; returns its figures, None without a fallback."""
    if table.fallback is not None:
        fallback = controller_preset(table.fallback)
    if fallback is None:
        say(NAME, "error: predictor: there is no pd_ddob for it to fall back to", sys.stderr)
        return None
    files = LawFiles(options.out, preset_name(spec, "predictor"))
    kept = kept_costs(files.search, spec, vehicle, fallback)
    with _bars(console, TextColumn("predictor")) as bars:
        task = bars.add_task(files.name, total=1.0, best="")
        lines = ProgressLines(NAME, is_shown=not console.is_terminal, minutes=options.minutes)

        def show(done: float, best: float) -> None:
            bars.update(task, completed=done, best=f"best {best:.4g}")
            lines.update({"predictor": done})
            if ctrl_c.is_pressed:
                raise SearchStoppedError

        progress = stopped_after(options.minutes, show)
        design = design_predictor(spec, table, vehicle, fallback, progress, kept)
    if design.ended:
        kept.forget()
    print(f"\npredictor  ({design.judged} sets of parameters judged)")
    for label, text in predictor_figures(spec, table, design):
        print(f"  {label:18}{text}")
    demands = predictor_demands(spec, table, design)
    if any(demand.excess for demand in demands):
        count = sum(demand.excess > 0.0 for demand in demands)
        say(NAME, f"error: predictor: {count} of {len(demands)} demands are not met", sys.stderr)
        files.write_unmet(unmet_text("predictor", design.settings, demands, sources))
        for line in unmet_lines(demands, files):
            print(line)
        return _figures(demands, is_met=False)
    files.write_preset(predictor_preset_text(spec, table, vehicle, design, sources))
    for line in written_lines(files, ended=design.ended):
        print(line)
    return _figures(demands, is_met=True)


def _figures(demands: Iterable[Demand], *, is_met: bool) -> Mapping[str, Any]:
    """Return what a law reaches of each demand, ready for JSON."""
    return {"is_met": is_met, "demands": [demand._asdict() for demand in demands]}


def _watch(
    console: Console,
    laws: Sequence[str],
    futures: Sequence[Future[Design]],
    shared: SharedProgress,
    minutes: float,
    ctrl_c: CtrlC,
) -> None:
    """Show the searches until all have ended."""
    with _bars(console, TextColumn("{task.description:8}")) as bars:
        tasks = [bars.add_task(law, total=1.0, best="") for law in laws]
        waiting: set[Future[Design]] = set(futures)
        lines = ProgressLines(NAME, is_shown=not console.is_terminal, minutes=minutes)
        while waiting:
            _, waiting = wait(waiting, timeout=_POLL_S)
            if ctrl_c.is_pressed:
                shared[-1] = 1.0
                for future in waiting:
                    future.cancel()
            done = [1.0 if f.done() else shared[2 * n] for n, f in enumerate(futures)]
            every = zip(laws, done, futures, strict=True)
            lines.update({law: share for law, share, future in every if future in waiting})
            for index, task in enumerate(tasks):
                best = shared[2 * index + 1]
                shown = f"best {best:.4g}" if 0.0 < best < 1e3 else ""
                bars.update(task, completed=done[index], best=shown)


def _bars(console: Console, name: TextColumn) -> Progress:
    best = TextColumn("{task.fields[best]}")
    return progress_bars(console, name, BarColumn(30), TimeRemainingColumn(), best)


def _lines(spec: Specification, design: Design, out: Path) -> Iterator[str]:
    judgement = design.found.judgement
    yield ""
    yield f"{design.law}  ({design.found.judged} sets of parameters judged)"
    yield from demand_lines(judgement)
    confirmation = design.found.confirmation
    if confirmation is not None:
        yield f"  stable up to      {confirmation.stable_up_to_ns / 1e6:g} ms"
        if spec.actuator is not None and confirmation.with_lag_up_to_ns is not None:
            lag_ms = confirmation.with_lag_up_to_ns / 1e6
            yield f"                    {lag_ms:g} ms behind a lag of {spec.actuator.lag_s:g} s"
        yield f"  slowest mode      {confirmation.decay_1_s:.3g} 1/s"
    if design.rms_held_up_to_ns is not None:
        yield f"  RMS limit kept    up to {design.rms_held_up_to_ns / 1e6:g} ms"
    for table, rms_m in zip(spec.jitter, design.jitter_rms_m, strict=True):
        yield f"  jitter            {rms_m:.4g} m at {table.mean_ms:g} ± {table.spread_ms:g} ms"
    for reason in design.reasons:
        yield from reason_lines(reason, judgement.objective)
    yield from written_lines(LawFiles(out, preset_name(spec, design.law)), design.found.ended)
