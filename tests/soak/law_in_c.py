"""Compare every preset whose law becomes C with Python, tick by tick, on every target there is.

    python -m tests.soak.law_in_c [--ticks 1000000] [--seed 1]

Targets: gcc and clang where installed, with -O0, -O2 and the sanitizers of addresses and undefined
behaviour; a Cortex-M7 under QEMU with -O2. Of that, also: flash and RAM of the law with its limits
and fades, the deepest stack of a tick, and its instructions, of which some 15 are the driver's.
Where Frama-C is installed (Debian: frama-c-base) it proves that no input, not a number included,
makes a command exceed the angle, for any number of periods. Ends with status 1 if a bit differs or
that is not proved. Takes about twenty minutes.
"""

import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from steer_by_wire.closed_loop.reports.terminal import plain_console
from steer_by_wire.controller.settings import controller_preset
from tests.support.in_c.law_in_c import (
    TICKS_A_RECORD,
    Target,
    built,
    differing,
    drawn,
    every_target,
    in_c,
    in_python,
    presets_in_c,
    written,
)
from tests.support.in_c.size_on_m7 import executed, logging_words, sizes

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
    """Print a line for each preset and target."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--ticks", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    targets = every_target()
    driven, differ, console = drawn(options.seed, options.ticks), 0, plain_console()
    for preset in presets_in_c():
        settings = controller_preset(preset)
        expected = in_python(settings, driven)
        with tempfile.TemporaryDirectory() as name:
            folder = written(settings, Path(name))
            for target in targets:
                tick = differing(expected, in_c(built(folder, target), driven, target.runner))
                differ += tick >= 0
                said = "equal" if tick < 0 else f"differs from tick {tick} on"
                console.print(f"{preset:<31} {target!s:<21} {options.ticks} ticks: {said}")
            firmware = targets[-1]
            short, long = (instructions(built(folder, firmware), firmware, it) for it in (10, 110))
            taken = ", ".join(sizes(folder, ["steering_law.c"], "steering_law.h", "law"))
            a_tick = (long - short) / (100 * TICKS_A_RECORD)
            console.print(f"{preset:<31} {taken}, {a_tick:.0f} instructions a tick")
            if shutil.which(EVA[0]):
                is_proved = proves(folder, settings.limits.steer_rad_max)
                differ += not is_proved
                console.print(f"{preset:<31} angle {'proved' if is_proved else 'not proved'}")
    return differ > 0


def proves(folder: Path, limit_rad: float) -> bool:
    """Return whether Frama-C proves the limit of the angle, and not a slightly lower one."""
    found = []
    for bound_rad in (limit_rad, 0.999 * limit_rad):
        source = ANY_COMMANDS.replace("MAX", repr(bound_rad))
        file = folder / "any_commands.c"
        file.write_text(source, encoding="utf-8")
        said = subprocess.run([*EVA, file], check=True, capture_output=True, text=True).stdout
        found.append("  1 valid     0 unknown     0 invalid      1 total" in said)
    return found == [True, False]


def instructions(program: Path, target: Target, records: int) -> int:
    """Return how many instructions QEMU executes for a run without starts but the first."""
    rows = np.zeros((records * TICKS_A_RECORD, 6))
    rows[:, 0], rows[0, 1] = 0.01, 1.0
    log = program.with_suffix(".executed")
    words = logging_words([*target.runner, str(program)], log)
    subprocess.run(words, input=rows.tobytes(), stdout=subprocess.DEVNULL, check=True)
    return executed(log)


if __name__ == "__main__":
    sys.exit(main())
