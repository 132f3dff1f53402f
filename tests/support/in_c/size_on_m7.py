"""What C takes of a Cortex-M7: flash, RAM, stack, and the instructions that QEMU executes."""

import re
import subprocess
from collections.abc import Iterator, Sequence
from pathlib import Path

from tests.support.in_c.law_in_c import M7_FLAGS

_FLAGS = [it for it in M7_FLAGS if it.startswith("-m")]


def sizes(folder: Path, sources: Sequence[str], header: str, state: str) -> Iterator[str]:
    """Yield what sources in a folder take, with one ``struct`` of a header as their state."""

    def said(*words: str, given: str | None = None) -> str:
        return subprocess.run(
            words, input=given, cwd=folder, check=True, stdout=subprocess.PIPE, text=True
        ).stdout

    compiler = "arm-none-eabi-gcc"
    said(compiler, "-c", "-std=c99", "-O2", "-ffp-contract=off", "-fstack-usage", *_FLAGS, *sources)
    stems = [it.removesuffix(".c") for it in sources]
    printed = said("arm-none-eabi-size", "-t", *(f"{it}.o" for it in stems))
    text, data, bss = (int(it) for it in printed.splitlines()[-1].split()[:3])
    given = f'#include "{header}"\nconst unsigned long state_bytes = sizeof(struct {state});'
    assembly = said(compiler, *_FLAGS, "-x", "c", "-S", "-o", "-", "-", given=given)
    state_bytes = re.search(r"\.word\s+(\d+)", assembly)
    assert state_bytes is not None
    yield f"flash {text + data} B, RAM {int(state_bytes[1]) + data + bss} B"
    used = [line for it in stems for line in (folder / f"{it}.su").read_text().splitlines()]
    # Nothing calls itself, so all functions together bound the stack.
    yield f"stack at most {sum(int(line.split()[-2]) for line in used)} B"


def logging_words(words: Sequence[str], log: Path) -> list[str]:
    """Return a command of QEMU that writes each instruction to a log."""
    options = ["-singlestep", "-d", "exec,nochain", "-D", str(log)]
    return [words[0], *options, *words[1:]]


def executed(log: Path) -> int:
    """Return how many instructions are in a log, which is removed."""
    with log.open(errors="replace") as lines:
        count = sum(line.startswith("Trace ") for line in lines)
    log.unlink()
    return count
