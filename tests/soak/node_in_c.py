"""Compare the node in C with the node in Python, frame by frame, for every law and target there is.

    python -m tests.soak.node_in_c [--examples 1000] [--laws pd pid] [--points nominal]

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
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from steer_by_wire.closed_loop.lockstep.program import LockstepProgram
from steer_by_wire.closed_loop.reports.terminal import plain_console
from steer_by_wire.controller.settings import ControllerSettings
from steer_by_wire.runtime.settings import load_settings, read_preset
from steer_by_wire.tools.faults.campaign import watched_pair
from steer_by_wire.tools.faults.campaign.campaign_file import CampaignSettings
from steer_by_wire.tools.faults.campaign.campaign_runs import Scenario, scenarios_of
from steer_by_wire.tools.generate_c.law_source import LAWS
from tests.support.law_in_c import Target, every_target
from tests.support.node_in_c import (
    NODE,
    ON_TIME,
    Segment,
    TwinNode,
    built_node,
    segments,
    settings_of,
    twins_agree,
)
from tests.support.size_on_m7 import executed, logging_words, sizes

POINTS = ("nominal", "slow and heavy, jitter and noise")
IMPATIENT = ("overruns.overruns_max=3", "overruns.missed_periods_max=40")
"""Limits that a drawn sequence exceeds."""


def main() -> int:
    """Print a line for each law, target and kind of run."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--examples", type=int, default=1000)
    parser.add_argument("--laws", nargs="*", default=LAWS)
    parser.add_argument("--points", nargs="*", default=POINTS)
    options = parser.parse_args()
    console, targets = plain_console(), every_target()
    for law in options.laws:
        preset = f"practical_{law}"
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            runs, frames = in_campaign(preset, options.points, folder, targets[1])
            console.print(f"{law:<8} {runs} runs of the campaign, {frames} frames: equal")
            for target in targets:
                ours = settings_of(preset, *(IMPATIENT if target is targets[0] else ()))
                frames = over_sequences(ours, built_node(ours, folder, target), options.examples)
                said = f"{options.examples} sequences, {frames} frames: equal"
                console.print(f"{law:<8} {target!s:<24} {said}")
            ours = settings_of(preset)
            a_period = instructions(ours, built_node(ours, folder, targets[-1]), folder)
            taken = ", ".join(sizes(folder, NODE[:-1], "node.h", "node"))
            console.print(f"{law:<8} {taken}, {a_period} instructions a control period")
    return 0


def in_campaign(preset: str, names: Sequence[str], folder: Path, target: Target) -> tuple[int, int]:
    """Return how many runs of the campaign at points of these names, and frames, were equal."""
    built_in = read_preset("steer_by_wire.tools.faults", "default")
    spec = load_settings(CampaignSettings, built_in, None, ["golden_seeds=1"])
    points = tuple(
        point.model_copy(update={"laws": (preset,)}) for point in spec.points if point.name in names
    )
    spec = spec.model_copy(update={"points": points})
    scenarios = [it for it in scenarios_of(spec) if it.case.receiver in ("controller", "both")]
    ours = settings_of(preset, f"supervision.fault_tolerant_time_ms={spec.ftti_ms}")
    words, frames = built_node(ours, folder, target), 0
    for scenario in scenarios:
        frames += in_run(scenario, ours, words)
    return len(scenarios), frames


def in_run(scenario: Scenario, ours: ControllerSettings, words: Sequence[str]) -> int:
    """Run a scenario with both nodes as the controller; returns the frames they sent."""
    twins: list[TwinNode] = []

    @contextmanager
    def both(*_: Any) -> Iterator[TwinNode]:
        with LockstepProgram(words) as program:
            twins.append(TwinNode(ours, program))
            yield twins[0]

    try:
        with patch.object(watched_pair, "controller_node", both):
            watched_pair.run_pair(scenario, watched_pair.make_pair(scenario))
    except AssertionError as error:
        raise AssertionError(f"{scenario.name}: {error}") from error
    return twins[0].frames


def over_sequences(ours: ControllerSettings, words: Sequence[str], examples: int) -> int:
    """Return how many frames of drawn sequences were equal."""
    frames = 0
    with LockstepProgram(words) as program:

        @given(segments(), st.integers(0, 1_000_000))
        @settings(max_examples=examples, deadline=None, database=None, phases=[Phase.generate],
                  suppress_health_check=[*HealthCheck])  # fmt: skip
        def agree(passing: Sequence[Segment], seed: int) -> None:
            nonlocal frames
            frames += twins_agree(ours, program, passing, seed).frames

        agree()
    return frames


def instructions(ours: ControllerSettings, words: Sequence[str], folder: Path) -> int:
    """Return what a control period takes, with its frames, a status frame in ten, and protocol."""
    counts = []
    for periods in (100, 300):
        log = folder / "executed.log"
        with LockstepProgram(logging_words(words, log)) as program:
            twins_agree(ours, program, [(ON_TIME, periods, 128)], 1)
        counts.append(executed(log))
    return round((counts[1] - counts[0]) / 200)


if __name__ == "__main__":
    sys.exit(main())
