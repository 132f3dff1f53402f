"""Run of a study: shows how far it is, and repeats one of its runs."""

import argparse
import importlib
import shlex
import time
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from pathlib import Path

from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress

from ...closed_loop.pair.pair_result import (
    BUS,
    CONTROLLER_PROGRAM,
    HAND_WHEEL_PROGRAM,
    PLANT_PROGRAM,
    PairFiles,
)
from ...closed_loop.reports.terminal import plain_console
from ...closed_loop.studies.compiled_figures import short_windows
from ...closed_loop.studies.result_files import Store
from ...closed_loop.studies.run_study import run_missing
from ...closed_loop.studies.scenario import Pair, Scenarios
from ...closed_loop.studies.study import load_study
from ...closed_loop.studies.workers import Workers, dask_workers, local_workers
from ...dbc.bus_language import read_language
from ...runtime.exit_status import ExitStatus
from ...runtime.input_file import read_bytes
from ...runtime.program.stop_request import StopRequest
from ...runtime.settings import SettingsError


def write_settings(scenarios: Scenarios, run: int, folder: Path) -> list[str]:
    """Write the settings of run number ``run``; returns the commands that run it again.

    Raises SettingsError where there is none of this number.
    """
    runs = scenarios.study.runs
    if not 0 <= run < runs:
        raise SettingsError(f"--replay {run}: the study has runs 0 to {runs - 1}")
    pair, files = scenarios.pair(run), PairFiles(folder / "replay" / str(run))
    others = [*read_language(pair.dialect).files, *map(Path, pair.command)]
    files.write_settings(pair.plant, pair.controller, pair.bus, others, pair.hand_wheel)
    return _commands(pair, files)


def _commands(pair: Pair, files: PairFiles) -> list[str]:
    """Return the commands that repeat the run, in virtual time and, without a bus, live."""
    bus = files.settings(BUS)
    programs = PLANT_PROGRAM, CONTROLLER_PROGRAM, HAND_WHEEL_PROGRAM
    plant, controller, wheel = (shlex.quote(str(files.settings(name))) for name in programs)
    program = f"--controller-command {shlex.quote(shlex.join(pair.command))}"
    run = f"steer-by-wire run {plant} {program if pair.command else f'--controller {controller}'}"
    run += f" --hand-wheel {wheel}" if pair.hand_wheel else ""
    run += f" --dialect {shlex.quote(pair.dialect)}" if pair.dialect else ""
    if bus.exists():
        return [f"{run} --bus-settings {shlex.quote(str(bus))}"]
    live = [f"plant {plant}", f"controller {controller}"]
    live += [f"hand-wheel {wheel}"] if pair.hand_wheel else []
    on_bus = " --interface socketcan --channel vcan0"
    return [
        f"{run} --ideal-wire",
        " & ".join(f"steer-by-wire {program}{on_bus}" for program in live),
    ]


def run_study(options: argparse.Namespace) -> int:
    """Compute what is missing of a study, or repeat one of its runs; returns the exit status."""
    console = plain_console()
    scenarios = Scenarios(load_study(options.study))
    scenarios.check()
    store = Store(options.out or Path("out/study") / scenarios.study.settings.name, scenarios)
    for line in _sizes(scenarios):
        console.print(line)
    warning = short_windows(scenarios.study.settings.verdict, scenarios.shortest_s)
    for each in (*([warning] if warning else []), *scenarios.warnings):
        console.print(f"warning: {each}")
    if options.dry_run:
        return ExitStatus.OK
    store.open(read_bytes(options.study).decode())
    stop = StopRequest()
    with stop.on_signals():
        if options.replay is not None:
            for command in write_settings(scenarios, options.replay, store.folder):
                console.print(f"again: {command}")
            return ExitStatus.OK
        with _workers(options, scenarios) as workers:
            is_complete = _compute(console, store, workers, scenarios.study.runs, stop)
    if not is_complete:
        stored = store.stored()
        console.print(
            f"interrupted: {stored:,} of {scenarios.study.runs:,} runs are stored in "
            f"{store.folder}; the same command goes on"
        )
        return ExitStatus.INTERRUPTED
    console.print(f"results: {store.results}")
    if not options.no_report:
        _report(console, store.folder)
    return ExitStatus.OK


def _sizes(scenarios: Scenarios) -> list[str]:
    study = scenarios.study
    sampling, design = study.settings.sampling, study.design
    lines = [
        f"study: {study.settings.name}" + (f": {study.settings.title}" * bool(study.settings.title))
    ]
    for factor in study.factors:
        labels = list(map(str, factor.labels))
        shown = ", ".join(labels if len(labels) <= 12 else [*labels[:6], "...", *labels[-2:]])
        lines.append(f"factor: {factor.name}: {f'{len(labels)}: {shown}' if labels else 'drawn'}")
    lines.append(f"controllers: {', '.join(scenarios.controllers)}")
    lines.append(
        f"runs: {study.runs:,} = {design.points:,} points ({sampling.kind}) x "
        f"{sampling.replicates:,} replicates x {len(scenarios.controllers)} controllers"
    )
    if study.on_nodes:
        lines.append("bus: the nodes run in virtual time, not compiled")
    return lines


def _workers(options: argparse.Namespace, scenarios: Scenarios) -> AbstractContextManager[Workers]:
    if options.scheduler:
        return dask_workers(scenarios.study, options.scheduler)
    return nullcontext(local_workers(scenarios, options.workers))


def _compute(
    console: Console, store: Store, workers: Workers, runs: int, stop: StopRequest
) -> bool:
    """Compute what is missing, showing the progress; returns whether the study is complete."""
    before = store.stored()
    if before:
        console.print(f"stored already: {before:,} runs in {store.folder}")
    begin_s = time.monotonic()
    columns = Progress.get_default_columns()
    with Progress(*columns, MofNCompleteColumn(), console=console) as progress:
        what = f"runs on {workers.description}"
        task = progress.add_task(what, total=runs, completed=before)
        is_complete = run_missing(store, workers, partial(progress.advance, task), stop)
        done = int(progress.tasks[0].completed) - before
    elapsed_s = time.monotonic() - begin_s
    if done:
        console.print(f"{done:,} runs in {elapsed_s:,.1f} s")
    return is_complete


def _report(console: Console, folder: Path) -> None:
    """Write the report of a complete study, where this installation has one."""
    try:
        report = importlib.import_module("steer_by_wire.tools.study.report")
        page, lines = report.write(folder)
    except ImportError as error:
        console.print(f"report: skipped: {error}")
        return
    for line in lines:
        console.print(line, soft_wrap=True)
    console.print(f"report: {page}")
