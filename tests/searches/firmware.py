"""Compare generated C with Python for every preset and target there is.

    python -m tests.searches.firmware [--ticks 1000000] [--examples 1000] [--presets NAME ...]

The law tick by tick, each bit; then the node frame by frame, through what Hypothesis draws: starts,
silences, refusals, counters, second senders, changes of speed, overruns. Targets: gcc and clang
where installed, with -O0, -O2 and the sanitizers of addresses and undefined behaviour; a Cortex-M7
under QEMU with -O2. Of that, also: flash, RAM, stack, and the instructions of a control period.
Where Frama-C is installed (Debian: frama-c-base) it proves that no input, not a number included,
makes a command exceed the angle, for any number of periods. Ends with status 1 at the first
difference. Takes about an hour.
"""

import argparse
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st

from steer_by_wire.closed_loop.reports.terminal import plain_console
from steer_by_wire.controller.settings import ControllerSettings, controller_preset
from tests.support.in_c import law_in_c
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
from tests.support.in_c.size_on_m7 import executed, logging_words, size_on_m7

IMPATIENT = ("overruns.overruns_max=3", "overruns.missed_periods_max=40")
"""Limits that a drawn sequence exceeds."""
LONG = (*((ON_TIME, 600, 125), (OVERRUN, 8, 125)) * 10, (SILENT, 500, 127))
"""A minute, in which a vehicle can prove to be another, and overruns are forgotten."""
SEQUENCES = 50
"""How many are kept in memory."""
ANY_COMMANDS = """
#include "steering_law.c"

volatile double any;
volatile int goes_on;

int main(void)
{
    double sent_rad = 0.0;

    while (goes_on) {
        sent_rad = limit_step(&STEER_LIMITS, sent_rad, any);
        /*@ assert \\is_finite(sent_rad) && -MAX <= sent_rad <= MAX; */
    }
    return 0;
}
"""
EVA = (
    *("frama-c", "-eva", "-warn-special-float", "none", "-eva-slevel", "200"),
    *("-eva-split-return-function", "is_finite:0:1"),
)


def main() -> int:
    """Print lines for each preset."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--ticks", type=int, default=1_000_000)
    parser.add_argument("--examples", type=int, default=1000)
    parser.add_argument("--presets", nargs="*", default=presets_in_c())
    options = parser.parse_args()
    console, targets = plain_console(), every_target()
    console.print(f"each on {', '.join(map(str, targets))}")
    for preset in options.presets:
        lines = (
            *check_law(preset, targets, options.ticks),
            *check_node(preset, targets, options.examples),
        )
        for line in lines:
            console.print(f"{preset:<31} {line}")
    return 0


def check_law(preset: str, targets: Sequence[Target], ticks: int) -> Iterator[str]:
    """Compare the law's ticks, and prove the limit of the angle."""
    ours, rows = controller_preset(preset), law_in_c.drawn(1, ticks)
    expected = law_in_c.in_python(ours, rows)
    with tempfile.TemporaryDirectory() as name:
        folder = law_in_c.written(ours, Path(name))
        for target in targets:
            found = law_in_c.in_c(law_in_c.built(folder, target), rows, target.runner)
            tick = law_in_c.differing(expected, found)
            if tick >= 0:
                raise AssertionError(f"{preset}, {target}: differs from tick {tick} on")
        yield f"{ticks} ticks of the law: equal"
        if shutil.which(EVA[0]):
            prove(folder, ours.limits.steer_rad_max)
            yield "limit of the angle: proved"


def prove(folder: Path, limit_rad: float) -> None:
    """Let Frama-C prove the limit of the angle, and not a slightly lower one."""
    found = []
    for bound_rad in (limit_rad, 0.999 * limit_rad):
        file = folder / "any_commands.c"
        file.write_text(ANY_COMMANDS.replace("MAX", repr(bound_rad)), encoding="utf-8")
        said = subprocess.run([*EVA, file], check=True, capture_output=True, text=True).stdout
        found.append("  1 valid     0 unknown     0 invalid      1 total" in said)
    assert found == [True, False]


def check_node(preset: str, targets: Sequence[Target], examples: int) -> Iterator[str]:
    """Compare the node's frames, and measure it."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for overrides in ((), IMPATIENT):
            ours = settings_of(preset, *overrides)
            programs = [built_node(ours, folder, target) for target in targets]
            runs = [driven(ours, LONG, number) for number in range(4)]
            for number in range(0, examples, SEQUENCES):
                runs += sequences(ours, number, min(SEQUENCES, examples - number))
                for words in programs:
                    agree(words, runs)
                runs = []
        yield f"{examples} sequences for the node, patient and impatient: equal"
        ours = controller_preset(preset)
        words = built_node(ours, folder, targets[-1])
        yield f"{instructions(ours, words, folder)} instructions a control period"
        yield str(size_on_m7(folder, NODE, b"".join(driven(ours, LONG, 1).asked)))


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
