"""Compare the node in C with the node in Python, frame by frame, for every law and target there is.

    python -m tests.soak.node_in_c [--examples 1000] [--presets practical_pid]

First a run with each fault of the measurements; then sequences that Hypothesis draws: starts,
silences, refusals, counters, second senders, changes of speed, overruns. Targets: gcc and clang
where installed, with -O0, -O2 and the sanitizers of addresses and undefined behaviour; a Cortex-M7
under QEMU with -O2. Of that, also: flash, RAM, the deepest stack, and the instructions of a control
period. Ends with status 1 at the first frame that differs. Takes about an hour.
"""

import argparse
import sys
import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path

from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

from steer_by_wire.closed_loop.reports.terminal import plain_console
from steer_by_wire.controller.settings import ControllerSettings
from tests.support.in_c.law_in_c import Target, every_target, presets_in_c
from tests.support.in_c.node_in_c import (
    NODE,
    ON_TIME,
    OVERRUN,
    SILENT,
    RecordedNode,
    Segment,
    agree,
    built_node,
    driven,
    segments,
    settings_of,
)
from tests.support.in_c.size_on_m7 import executed, logging_words, sizes
from tests.support.runs.fault_cases import DETECTED, UNDETECTED, run_with

IMPATIENT = ("overruns.overruns_max=3", "overruns.missed_periods_max=40")
"""Limits that a drawn sequence exceeds."""
LONG = (*((ON_TIME, 600, 125), (OVERRUN, 8, 125)) * 10, (SILENT, 500, 127))
"""A minute, in which a vehicle can prove to be another, and overruns are forgotten."""
LONG_RUNS = 4
SEQUENCES = 50
"""How many are kept in memory, and have a line together."""


def main() -> int:
    """Print a line for each preset and kind of run, of so many at a time."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--examples", type=int, default=1000)
    parser.add_argument("--presets", nargs="*", default=presets_in_c())
    options = parser.parse_args()
    console, targets = plain_console(), every_target()
    console.print(f"each on {', '.join(map(str, targets))}")
    for preset in options.presets:

        def say(what: str, runs: Sequence[RecordedNode], preset: str = preset) -> None:
            frames = sum(run.frames for run in runs)
            console.print(f"{preset:<31} {len(runs)} {what}, {frames} frames: equal")

        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            ours = settings_of(preset)
            programs = built(ours, folder, targets)
            runs = faulty(ours)
            agree_all(programs, runs)
            say("runs with a fault", runs)
            runs = [driven(ours, LONG, seed) for seed in range(LONG_RUNS)]
            agree_all(programs, runs)
            say("runs of a minute", runs)
            for overrides in ((), IMPATIENT) if options.examples else ():
                ours = settings_of(preset, *overrides)
                programs = built(ours, folder, targets)
                for number in range(0, options.examples, SEQUENCES):
                    runs = sequences(ours, number, min(SEQUENCES, options.examples - number))
                    agree_all(programs, runs)
                    said = "impatient" if overrides else "patient"
                    say(f"sequences from {number} on, {said}", runs)
            ours = settings_of(preset)
            a_period = instructions(ours, built_node(ours, folder, targets[-1]), folder)
            taken = ", ".join(sizes(folder, NODE[:-1], "node.h", "node"))
            console.print(f"{preset:<31} {taken}, {a_period} instructions a control period")
    return 0


def faulty(ours: ControllerSettings) -> list[RecordedNode]:
    """Run the node with each fault of the measurements."""
    runs = []
    for case in (*DETECTED, *UNDETECTED):
        if case.settings.direction == "uplink":
            runs.append(RecordedNode(ours, name=f"{case.kind} {case.message}"))
            run_with([case.settings], runs[-1])
    return runs


def built(
    ours: ControllerSettings, folder: Path, targets: Iterable[Target]
) -> dict[Target, Sequence[str]]:
    """Return the words that run a node, by target."""
    return {target: built_node(ours, folder, target) for target in targets}


def agree_all(programs: dict[Target, Sequence[str]], runs: Sequence[RecordedNode]) -> None:
    """Compare runs on every target."""
    for target, words in programs.items():
        try:
            agree(words, runs)
        except AssertionError as error:
            raise AssertionError(f"{target}: {error}") from error


def sequences(ours: ControllerSettings, number: int, count: int) -> list[RecordedNode]:
    """Drive the node through drawn sequences; the same number draws the same ones."""
    runs: list[RecordedNode] = []

    @seed(number)
    @given(segments(), st.integers(0, 1_000_000))
    @settings(max_examples=count, deadline=None, database=None, phases=[Phase.generate],
              suppress_health_check=[*HealthCheck])  # fmt: skip
    def drive(passing: Sequence[Segment], seed: int) -> None:
        runs.append(driven(ours, passing, seed))

    drive()
    return runs


def instructions(ours: ControllerSettings, words: Sequence[str], folder: Path) -> int:
    """Return what a control period takes, with its frames, a status frame in ten, and protocol."""
    counts = []
    for periods in (100, 300):
        log = folder / "executed.log"
        agree(logging_words(words, log), [driven(ours, [(ON_TIME, periods, 128)], 1)])
        counts.append(executed(log))
    return round((counts[1] - counts[0]) / 200)


if __name__ == "__main__":
    sys.exit(main())
