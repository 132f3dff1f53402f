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
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from steer_by_wire.closed_loop.reports.terminal import plain_console
from steer_by_wire.controller.settings import PRESETS, controller_preset
from steer_by_wire.runtime.settings import preset_names
from steer_by_wire.tools.generate_c.law_source import LAWS
from tests.support.law_in_c import (
    TICKS_A_RECORD,
    Target,
    built,
    differing,
    drawn,
    hosts,
    in_c,
    in_python,
    m7,
    written,
)

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
SANITIZED = ("-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")


def main() -> int:
    """Print a line for each preset and target."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--ticks", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    host = hosts()
    firmware = m7("-O2")
    targets = [*host, *(Target(it.compiler, SANITIZED) for it in host[::2]), firmware]
    driven, differ, console = drawn(options.seed, options.ticks), 0, plain_console()
    for preset in preset_names(PRESETS):
        settings = controller_preset(preset)
        if settings.law not in LAWS:
            continue
        expected = in_python(settings, driven)
        with tempfile.TemporaryDirectory() as name:
            folder = written(settings, Path(name))
            for target in targets:
                tick = differing(expected, in_c(built(folder, target), driven, target.runner))
                differ += tick >= 0
                said = "equal" if tick < 0 else f"differs from tick {tick} on"
                console.print(f"{preset:<31} {target!s:<21} {options.ticks} ticks: {said}")
            console.print(f"{preset:<31} {', '.join(sizes(folder, firmware))}")
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


def sizes(folder: Path, target: Target) -> Iterator[str]:
    """Yield what the law takes of a Cortex-M7."""
    program = built(folder, target)
    flags = [it for it in target.options if it.startswith(("-m", "-O"))]
    only = [target.compiler, "-c", "-std=c99", "-ffp-contract=off", "-fstack-usage", *flags]
    subprocess.run([*only, "steering_law.c"], cwd=folder, check=True)
    size = ["arm-none-eabi-size", "steering_law.o"]
    printed = subprocess.run(size, cwd=folder, check=True, capture_output=True, text=True).stdout
    text, data, bss = (int(it) for it in printed.splitlines()[1].split()[:3])
    state = subprocess.run(
        [target.compiler, *flags, "-x", "c", "-S", "-o", "-", "-"],
        input='#include "steering_law.h"\nconst unsigned long law_bytes = sizeof(struct law);',
        cwd=folder, check=True, capture_output=True, text=True,
    ).stdout  # fmt: skip
    law_bytes = re.search(r"\.word\s+(\d+)", state)
    assert law_bytes is not None
    used = (folder / "steering_law.su").read_text().splitlines()
    yield f"flash {text + data} B, RAM {int(law_bytes[1]) + data + bss} B"
    # Nothing calls itself, so all functions together bound the stack.
    yield f"stack at most {sum(int(line.split()[-2]) for line in used)} B"
    short, long = (instructions(program, target, count) for count in (10, 110))
    yield f"{(long - short) / (100 * TICKS_A_RECORD):.0f} instructions a tick"


def instructions(program: Path, target: Target, records: int) -> int:
    """Return how many instructions QEMU executes for a run without starts but the first."""
    rows = np.zeros((records * TICKS_A_RECORD, 6))
    rows[:, 0], rows[0, 1] = 0.01, 1.0
    log = program.with_suffix(".executed")
    options = ["-singlestep", "-d", "exec,nochain", "-D", str(log)]
    words = [target.runner[0], *options, *target.runner[1:], str(program)]
    subprocess.run(words, input=rows.tobytes(), stdout=subprocess.DEVNULL, check=True)
    count = log.read_text(errors="replace").count("Trace ")
    log.unlink()
    return count


if __name__ == "__main__":
    sys.exit(main())
