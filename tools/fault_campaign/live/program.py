"""Runs the live campaign case by case; prints a table and writes ``campaign_live.json``."""

import sys
import time
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from rich.console import Console

from ....pair.processes import ProcessError
from ....runtime.bus import BusError
from ....runtime.host import StealClock
from ....runtime.report import write_json
from .cases import CASES, LiveCase
from .judgement import Outcome, judge_trial
from .presentation import outcome_table, record_of
from .trial import run_trial, write_excerpt

NAME = "live campaign"
WIDTH = 150
"""Width of the table, whose figures are no use cut short."""
FILE = "campaign_live.json"
_KEY_LIBRARY = "cryptography"


def run_live_campaign(folder: Path, seed: int, cases: Sequence[LiveCase] = CASES) -> list[Outcome]:
    """Run the cases, print the results and write them to ``folder``.

    The first case is without a fault: a replay sends its recording. Raises BusError when a process
    does not start or does not end.
    """
    folder.mkdir(parents=True, exist_ok=True)
    steal, begin_s = StealClock(), time.monotonic()
    outcomes: list[Outcome] = []
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
    return outcomes


def _folder_name(case: LiveCase) -> str:
    return "".join(one if one.isalnum() or one == "." else "_" for one in case.name)
