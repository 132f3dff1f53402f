"""Compare the node in C with the node in Python, frame by frame, for every law and target there is.

    python -m tests.soak.node_in_c [--examples 1000] [--presets practical_pid] [--points nominal]

First the runs of the fault campaign in which the controller has something to detect, at its
operating points; then sequences that Hypothesis draws: starts, silences, refusals, counters, second
senders, changes of speed, overruns. Targets: gcc and clang where installed, with -O0, -O2 and the
sanitizers of addresses and undefined behaviour; a Cortex-M7 under QEMU with -O2. Of that, also:
flash, RAM, the deepest stack, and the instructions of a control period. Ends with status 1 at the
first frame that differs. Takes about an hour.
"""

import argparse
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

from steer_by_wire.closed_loop.reports.terminal import plain_console
from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.runtime.settings import load_settings, read_preset
from steer_by_wire.tools.faults.campaign import watched_pair
from steer_by_wire.tools.faults.campaign.campaign_file import CampaignSettings, PointSettings
from steer_by_wire.tools.faults.campaign.campaign_runs import Scenario, scenarios_of
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
    parser.add_argument("--points", nargs="*", help="of the campaign, by name; default: all")
    options = parser.parse_args()
    console, targets = plain_console(), every_target()
    console.print(f"each on {', '.join(map(str, targets))}")
    spec = campaign()
    points = [it for it in spec.points if options.points is None or it.name in options.points]
    for preset in options.presets:

        def say(what: str, runs: Sequence[RecordedNode], preset: str = preset) -> None:
            frames = sum(run.frames for run in runs)
            console.print(f"{preset:<31} {len(runs)} {what}, {frames} frames: equal")

        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            ours = settings_of(preset, f"supervision.fault_tolerant_time_ms={spec.ftti_ms}")
            programs = built(ours, folder, targets)
            for point in points:
                runs = [in_python(it, ours) for it in faulty(spec, point, preset)]
                agree_all(programs, runs)
                say(f"runs at {point.name}", runs)
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


def campaign() -> CampaignSettings:
    """Return the built-in campaign, with one golden run for each point and law."""
    built_in = read_preset("steer_by_wire.tools.faults", "default")
    return load_settings(CampaignSettings, built_in, None, ["golden_seeds=1"])


def faulty(spec: CampaignSettings, point: PointSettings, preset: str) -> Iterator[Scenario]:
    """Yield the runs of a point in which the controller has something to detect."""
    points = (point.model_copy(update={"laws": (preset,)}),)
    for scenario in scenarios_of(spec.model_copy(update={"points": points})):
        if scenario.case.receiver in ("controller", "both"):
            yield scenario


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


def in_python(scenario: Scenario, ours: ControllerSettings) -> RecordedNode:
    """Run a scenario of the campaign."""
    node = RecordedNode(ours, name=scenario.name)

    @contextmanager
    def recorded(*_: Any) -> Iterator[RecordedNode]:
        yield node

    with patch.object(watched_pair, "controller_node", recorded):
        watched_pair.run_pair(scenario, watched_pair.make_pair(scenario))
    return node


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
