"""The start of a program, timed to its first frame on an emulated bus, and what it imports."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from benchmarks.measurement import Line, Target
from steer_by_wire.closed_loop.pair.live_bus import Bus
from steer_by_wire.closed_loop.processes.process_group import launched_broker
from steer_by_wire.runtime.exit_status import BusError

PROGRAMS = {
    "plant_emulator": ["--preset", "paper_nominal"],
    "controller": ["--preset", "practical_pd_ddob"],
}
"""The programs, and a usual command line of each."""
HEAVY = ("numba", "scipy", "matplotlib")
"""What no live process needs; each alone takes longer to import than all the rest."""
REPETITIONS = 5
TARGET_S = 1.0
TIMEOUT_S = 30.0
_NO_BYTECODE = "PYTHONDONTWRITEBYTECODE"
_IMPORTED = re.compile(r"import time: .*\| +(\S+)")


class StartupError(BusError):
    """A program has not started; the text is one line for the user."""


def startup_lines() -> list[Line]:
    """Time each program from its start to its first frame on an emulated bus."""
    lines = []
    with launched_broker() as address:
        bus = Bus("emulated", "startup", {"address": address})
        for program in PROGRAMS:
            seconds = [_first_frame_s(program, bus) for _ in range(REPETITIONS)]
            each_us, target = [1e6 * value_s for value_s in seconds], Target(True, TARGET_S)
            lines.append(Line(f"start of {program}", "s", seconds, each_us, target))
    return lines


def heavy_modules() -> dict[str, list[str]]:
    """Return which of HEAVY each program has imported when its first frame is out."""
    with launched_broker() as address:
        bus = Bus("emulated", "imports", {"address": address})
        return {program: _heavy_imports(program, bus) for program in PROGRAMS}


def _first_frame_s(program: str, bus: Bus) -> float:
    with bus.open() as listener:
        begin_s = time.perf_counter()
        with _running(program, bus, ()):
            if listener.recv(TIMEOUT_S) is None:
                raise StartupError(f"{program} has sent no frame within {TIMEOUT_S:g} s")
            return time.perf_counter() - begin_s


def _heavy_imports(program: str, bus: Bus) -> list[str]:
    with bus.open() as listener, _running(program, bus, ("-X", "importtime")) as process:
        listener.recv(TIMEOUT_S)
        process.send_signal(signal.SIGINT)
        _, printed = process.communicate()
    modules = {match[1] for match in _IMPORTED.finditer(printed)}
    if f"steer_by_wire.{program}" not in modules:
        raise StartupError(f"{program} does not report what it imports")
    return [package for package in HEAVY if package in modules]


@contextmanager
def _running(
    program: str, bus: Bus, python_options: Sequence[str]
) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-P", *python_options, "-m", f"steer_by_wire.{program}"]
    command += [*bus.options, *PROGRAMS[program]]
    # An installed program has its bytecode stored: the first start may write it.
    environment = {key: os.environ[key] for key in os.environ if key != _NO_BYTECODE}
    with subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, env=environment
    ) as process:
        try:
            yield process
        finally:
            process.send_signal(signal.SIGINT)
