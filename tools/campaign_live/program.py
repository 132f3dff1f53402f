"""Runs the live campaign case by case; prints a table and writes ``campaign_live.json``."""

import sys
import time
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from runtime.host import StealClock
from runtime.program import ExitStatus
from runtime.report import write_json
from tools.campaign_live.cases import CASES, CONTROLLER, PLANT, LiveCase
from tools.campaign_live.judgement import Outcome, Telling, judge_trial
from tools.campaign_live.trial import run_trial, write_excerpt
from tools.soak.crew import SoakError

NAME = "live campaign"
NOT_SHOWN = 1
WIDTH = 150
"""Of the table, whose figures are no use cut short."""
FILE = "campaign_live.json"
_KEY_LIBRARY = "cryptography"


def run_live_campaign(folder: Path, seed: int, cases: Sequence[LiveCase] = CASES) -> int:
    """Run the cases, print what came of them and write it to ``folder``; returns the exit status.

    0 when every fault was noticed by those who must, 1 when not, 3 when a process has failed.
    The first case is the one without a fault: a replay sends what it has recorded.
    """
    folder.mkdir(parents=True, exist_ok=True)
    steal, begin_s = StealClock(), time.monotonic()
    outcomes = []
    recording = folder / "recording.log"
    for number, case in enumerate(cases, start=1):
        if case.with_key and find_spec(_KEY_LIBRARY) is None:
            print(f"{NAME}: {case.name}: left out, needs {_KEY_LIBRARY}", file=sys.stderr)
            continue
        print(f"{NAME}: {number} of {len(cases)}: {case.name}", file=sys.stderr, flush=True)
        try:
            trial = run_trial(case, folder / _folder_name(case), seed, recording)
        except SoakError as error:
            print(f"{NAME}: error: {case.name}: {error}", file=sys.stderr)
            return ExitStatus.BUS
        outcomes.append(judge_trial(trial))
        if len(outcomes) == 1:
            write_excerpt(trial.bus_log, recording)
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
    return NOT_SHOWN if any(outcome.mistakes for outcome in outcomes) else ExitStatus.OK


def record_of(outcome: Outcome) -> dict[str, Any]:
    """Return one run, ready for JSON."""
    return {
        **outcome._asdict(),
        "tellings": {name: telling._asdict() for name, telling in outcome.tellings.items()},
        "vehicle": outcome.vehicle._asdict(),
    }


def outcome_table(outcomes: Sequence[Outcome]) -> Table:
    """Return the runs as a table; times in ms after the onset, noticed / told on the bus."""
    table = Table(title="live campaign: noticed / told on the bus, ms after the onset")
    for heading in ("fault", "plant counts", "controller counts"):
        table.add_column(heading, overflow="fold")
    for heading in ("plant", "controller", "error m", "wheel rad"):
        table.add_column(heading, justify="right", no_wrap=True)
    for heading in ("vehicle", "exit", "verdict"):
        table.add_column(heading, no_wrap=True)
    for outcome in outcomes:
        vehicle = outcome.vehicle
        table.add_row(
            outcome.name,
            _counts(outcome, PLANT),
            _counts(outcome, CONTROLLER),
            _times(outcome.tellings[PLANT]),
            _times(outcome.tellings[CONTROLLER]),
            f"{_figure(vehicle.error_before_m)} → {_figure(vehicle.error_peak_m)}",
            f"{_figure(vehicle.wheel_before_rad)} → {_figure(vehicle.wheel_peak_rad)}",
            "killed" if outcome.statuses[PLANT] < 0 else vehicle.last_status,
            f"{outcome.statuses[PLANT]} / {outcome.statuses[CONTROLLER]}",
            "not passed" if outcome.mistakes else "passed",
        )
    return table


def _counts(outcome: Outcome, name: str) -> str:
    if name not in outcome.counts:
        return "no report"
    return ", ".join(f"{cause} {n}" for cause, n in outcome.counts[name].items()) or "none"


def _times(telling: Telling) -> str:
    return " / ".join("-" if one is None else f"{1e3 * one:.0f}" for one in telling)


def _figure(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def _folder_name(case: LiveCase) -> str:
    return case.name.replace(",", "").replace(" ", "_")
