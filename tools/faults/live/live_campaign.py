"""Runs the live campaign case by case; prints a table and writes ``campaign_live.json``."""

import sys
import time
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table as TerminalTable

from ....closed_loop.pair.pair_result import CONTROLLER_PROGRAM, PLANT_PROGRAM
from ....closed_loop.processes.process_group import ProcessError
from ....closed_loop.reports.findings import Finding
from ....closed_loop.reports.page import Cell, Section, Table, number
from ....runtime.exit_status import BusError
from ....runtime.program.priority_and_memory_lock import StealClock
from ....runtime.program.report import write_json
from .cases import LiveCase, live_cases
from .judgement import LiveResult, Reaction, judge_trial
from .live_trial import run_trial, write_excerpt

NAME = "live campaign"
WIDTH = 150
"""Width of the table, whose figures are no use cut short."""
FILE = "campaign_live.json"
_KEY_LIBRARY = "cryptography"


def run_live_campaign(folder: Path, seed: int) -> list[LiveResult]:
    """Run all cases, print the results and write them to ``folder``.

    The first case is without a fault: a replay sends its recording. Raises BusError when a process
    does not start or does not end.
    """
    cases = live_cases()
    folder.mkdir(parents=True, exist_ok=True)
    steal, begin_s = StealClock(), time.monotonic()
    outcomes: list[LiveResult] = []
    recording = folder / "recording.log"
    for place, case in enumerate(cases, start=1):
        if case.with_key and find_spec(_KEY_LIBRARY) is None:
            print(f"{NAME}: {case.name}: left out, needs {_KEY_LIBRARY}", file=sys.stderr)
            continue
        print(f"{NAME}: {place} of {len(cases)}: {case.name}", file=sys.stderr, flush=True)
        try:
            trial = run_trial(case, folder / _folder_name(case), seed, recording)
        except ProcessError as error:
            raise BusError(f"{NAME}: {case.name}: {error}") from error
        outcomes.append(judge_trial(trial))
        if len(outcomes) == 1:
            write_excerpt(trial.run.bus_log, recording)
    record = {
        "seed": seed,
        "duration_s": time.monotonic() - begin_s,
        "steal_fraction": steal.fraction(),
        "runs": [record_of(outcome) for outcome in outcomes],
    }
    write_json(folder / FILE, record)
    console = Console(markup=False, highlight=False, width=WIDTH)
    console.print(outcome_table(outcomes))
    for outcome in outcomes:
        for mistake in outcome.mistakes:
            console.print(f"{outcome.name}: {mistake}")
    return outcomes


def _folder_name(case: LiveCase) -> str:
    return "".join(one if one.isalnum() or one == "." else "_" for one in case.name)


_WHAT = (
    "Real processes on the emulated bus, one fault at a time, a second long. Noticed: when a "
    "program's own recording first shows a mode or a count that says so. Reported: when that frame "
    "was complete on the bus. Both in milliseconds after the onset; a shared machine may stall, "
    "so they are reported and not judged. Counts are those of the programs' reports. Error is "
    "the largest one at the preview point, before the onset and after it."
)
_HEADINGS = (
    *("fault", "plant counts", "controller counts", "plant noticed / reported"),
    *("controller noticed / reported", "error [m]", "plant ends as", "exit", "verdict"),
)


def live_finding(outcomes: Sequence[LiveResult]) -> Finding:
    """Return whether every live run was as it must be."""
    failed = [one for one in outcomes if one.mistakes]
    first = f"; first: {failed[0].name}: {failed[0].mistakes[0]}" if failed else ""
    return Finding(
        "live: noticed by those who must, ended as they should, nothing left behind",
        not failed,
        f"{len(outcomes) - len(failed)} of {len(outcomes)} runs{first}",
    )


def live_section(outcomes: Sequence[LiveResult]) -> Section:
    """Return the section of the page."""
    rows = [
        [
            *map(Cell, row[:3]),
            *map(_unbroken, row[3:6]),
            Cell(row[6]),
            _unbroken(row[7]),
            Cell("; ".join(outcome.mistakes) or "passed"),
        ]
        for outcome, row in zip(outcomes, map(_row, outcomes), strict=True)
    ]
    return Section("Live runs", [_WHAT], tables=[Table(_HEADINGS, rows)])


def record_of(outcome: LiveResult) -> dict[str, Any]:
    """Return one run, ready for JSON."""
    return {
        **outcome._asdict(),
        "reactions": {name: reaction._asdict() for name, reaction in outcome.reactions.items()},
        "vehicle": outcome.vehicle._asdict(),
    }


def outcome_table(outcomes: Sequence[LiveResult]) -> TerminalTable:
    """Return the runs as a table; times in ms after the onset, noticed / reported on the bus."""
    table = TerminalTable(title="live campaign: noticed / reported on the bus, ms after the onset")
    for heading in ("fault", "plant counts", "controller counts"):
        table.add_column(heading, overflow="fold")
    for heading in ("plant", "controller", "error m"):
        table.add_column(heading, justify="right", no_wrap=True)
    for heading in ("vehicle", "exit", "verdict"):
        table.add_column(heading, no_wrap=True)
    for outcome in outcomes:
        table.add_row(*_row(outcome), "not passed" if outcome.mistakes else "passed")
    return table


def _row(outcome: LiveResult) -> list[str]:
    vehicle = outcome.vehicle
    return [
        outcome.name,
        _counts(outcome, PLANT_PROGRAM),
        _counts(outcome, CONTROLLER_PROGRAM),
        _times(outcome.reactions[PLANT_PROGRAM]),
        _times(outcome.reactions[CONTROLLER_PROGRAM]),
        f"{_figure(vehicle.error_before_m)} → {_figure(vehicle.error_peak_m)}",
        "killed" if outcome.statuses[PLANT_PROGRAM] < 0 else vehicle.last_status,
        f"{outcome.statuses[PLANT_PROGRAM]} / {outcome.statuses[CONTROLLER_PROGRAM]}",
    ]


def _unbroken(text: str) -> Cell:
    """Return the cell of a number, which stays on one line."""
    return number(text.replace(" ", "\N{NO-BREAK SPACE}"))


def _counts(outcome: LiveResult, name: str) -> str:
    if name not in outcome.counts:
        return "no report"
    return ", ".join(f"{cause} {n}" for cause, n in outcome.counts[name].items()) or "none"


def _times(reaction: Reaction) -> str:
    return " / ".join("-" if one is None else f"{1e3 * one:.0f}" for one in reaction)


def _figure(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"
