"""Flash, RAM and stack of C on a Cortex-M7, and the instructions that QEMU executes."""

import re
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from tests.support.in_c.law_in_c import M7_FLAGS, PROTOCOL, QEMU, STRICT

COMPILER = "arm-none-eabi-gcc"
PAINTED = """
#include <stdint.h>

enum { PAINT = 0x5AA55AA5, SYS_WRITE0 = 4 };

extern uint32_t bss_end[], stack_top[];
int __real_main(void);
int __wrap_main(void);

/* Paint all memory below this function's frame, and print how deep the stack was in main. */
int __wrap_main(void)
{
    uint32_t *word = bss_end, *end;
    char said[] = "stack 00000000\\n";

    __asm__ volatile("mov %0, sp" : "=r"(end));
    while (word < end)
        *word++ = (uint32_t)PAINT;
    const int result = __real_main();
    for (word = bss_end; word < end && *word == (uint32_t)PAINT;)
        word++;
    uint32_t used = (uint32_t)((uint8_t *)stack_top - (uint8_t *)word);
    for (int digit = 13; digit > 5; digit--, used >>= 4)
        said[digit] = "0123456789abcdef"[used & 15];
    register uintptr_t r0 __asm__("r0") = SYS_WRITE0;
    register const void *r1 __asm__("r1") = said;
    __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
    return result;
}
"""


class Size(NamedTuple):
    """What a program takes [bytes].

    ``static``       RAM for its variables, those of the lockstep protocol included
    ``stack``        as a run has used it
    ``stack_bound``  the frames of all functions together: nothing calls itself
    """

    flash: int
    static: int
    stack: int
    stack_bound: int


def size_on_m7(folder: Path, sources: Sequence[str], asked: bytes) -> Size:
    """Measure the program of some sources of a folder, which is given ``asked``."""
    (folder / "painted.c").write_text(PAINTED, encoding="utf-8")
    options = [*STRICT, "-O2", *M7_FLAGS, "-fstack-usage", "-Wl,--wrap=main"]
    command = [COMPILER, *options, "-o", "painted.elf", *sources, "painted.c"]
    subprocess.run([*command, str(PROTOCOL / "m7.c"), "-lgcc"], cwd=folder, check=True)
    run = subprocess.run([*QEMU, "painted.elf"], cwd=folder, input=asked, capture_output=True)
    used = re.search(rb"stack ([0-9a-f]{8})", run.stderr)
    assert used is not None, run.stderr
    size = ("arm-none-eabi-size", "painted.elf")
    printed = subprocess.run(size, cwd=folder, check=True, capture_output=True, text=True).stdout
    text, data, bss = (int(it) for it in printed.splitlines()[-1].split()[:3])
    usage = [line for file in folder.glob("*.su") for line in file.read_text().splitlines()]
    frames = [int(line.split()[-2]) for line in usage]
    return Size(text + data, data + bss, int(used[1], 16), sum(frames))
