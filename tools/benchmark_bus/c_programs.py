"""Compiles the C programs of the benchmark, each time into a folder that is thrown away."""

import shutil
import subprocess
from pathlib import Path
from typing import NamedTuple

from ...runtime.bus import BusError

SOURCES = Path(__file__).parent
FLAGS = ("-std=gnu11", "-O2", "-Wall", "-Wextra", "-Werror")


class CompileError(BusError):
    """The C programs cannot be compiled; the text is one line for the user."""


class CPrograms(NamedTuple):
    """The compiled programs; each source describes what its program does."""

    echo: Path
    requester: Path
    timer_loop: Path


def compile_all(folder: Path) -> CPrograms:
    """Compile every program into ``folder``; raises CompileError."""
    if shutil.which("gcc") is None:
        raise CompileError("the C programs to compare with need gcc (apt-get install gcc)")
    return CPrograms(*(_compile(name, folder) for name in CPrograms._fields))


def _compile(name: str, folder: Path) -> Path:
    source, program = SOURCES / f"{name}.c", folder / name
    command = ["gcc", *FLAGS, "-o", str(program), str(source)]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    if result.returncode:
        first = next((line for line in result.stderr.splitlines() if "error" in line), "")
        raise CompileError(f"gcc does not compile {source.name}: {first or result.stderr.strip()}")
    return program
