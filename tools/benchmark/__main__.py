"""Measure how fast the programs are on this machine, against the targets.

    steer-by-wire benchmark [--json FILE] [--against SAVED]

Prints the median of several repetitions with the least and the most, the target where there is one,
and the ratio of the time behind each figure to that of a fixed loop of arithmetic. A start is timed
to the program's first frame on an emulated bus. A wide spread means that other programs used the
machine; a missed target then means little. ``--against`` lists what has become slower since a file
written by ``--json``.
"""

import argparse
import json
import os
import platform
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console

from steer_by_wire.closed_loop.live_bus import Bus
from steer_by_wire.closed_loop.processes import launched_broker
from steer_by_wire.runtime.command_line import command_parser
from steer_by_wire.runtime.port.python_can import BusError
from steer_by_wire.runtime.program.host import StealClock
from steer_by_wire.runtime.program.option_types import add_json_argument
from steer_by_wire.runtime.program.program import ExitStatus, run_main
from steer_by_wire.runtime.program.report import write_json
from steer_by_wire.runtime.settings import SettingsError
from steer_by_wire.tools.benchmark.loop import (
    controller_node_line,
    frame_lines,
    law_lines,
    virtual_time_lines,
)
from steer_by_wire.tools.benchmarking.measurement import (
    Line,
    Target,
    calibration,
    line_record,
    lines_table,
    steal_text,
)

NAME = "steer-by-wire benchmark"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run all benchmarks; returns the exit status, which does not depend on the figures."""
    parser = command_parser(
        NAME, __doc__, f"{NAME} --json before.json\n{NAME} --against before.json"
    )
    add_json_argument(parser)
    parser.add_argument(
        "--against", type=Path, metavar="SAVED", help="list what is slower than in a saved file"
    )
    options = parser.parse_args(arguments)
    return run_main(NAME, partial(_run, options))


def _run(options: argparse.Namespace) -> int:
    before = None if options.against is None else read_ratios(options.against)
    now = _benchmark(options.json)
    if before is not None:
        print(comparison_text(before, now))
    return ExitStatus.OK


def _benchmark(json_file: Path | None) -> dict[str, float]:
    console, steal = Console(), StealClock()
    loop = calibration()
    lines = [
        *law_lines(),
        *frame_lines(),
        controller_node_line(),
        *virtual_time_lines(),
        *startup_lines(),
    ]
    heavy, stolen = heavy_modules(), steal.fraction()
    machine = {
        "python": f"{platform.python_implementation()} {platform.python_version()}",
        "platform": platform.platform(),
        "processors": os.cpu_count(),
        "steal_fraction": stolen,
    }
    console.print(lines_table([loop, *lines], loop.median))
    for program, modules in heavy.items():
        console.print(
            f"heavy modules {program} imports (target: none): {', '.join(modules) or 'none'}"
        )
    console.print(f"{machine['python']}, {machine['processors']} processors, ", end="")
    console.print(steal_text(stolen))
    records = [
        {**line_record(line), "ratio_to_calibration": line.ratio(loop.median)} for line in lines
    ]
    if json_file is not None:
        content = {"machine": machine, "calibration_us": loop.median, "lines": records}
        write_json(json_file, content | {"heavy_modules": heavy})
    return ratios_of(records)


SLOWER = 1.3
"""From this factor on a figure counts as slower: repetitions on a busy machine differ by less."""


class Change(NamedTuple):
    """One figure before and now; ``factor`` is now over before, in calibration loops each."""

    name: str
    factor: float


def read_ratios(file: Path) -> dict[str, float]:
    """Return the ratios to the calibration loop in a saved benchmark; raises SettingsError."""
    try:
        return ratios_of(json.loads(file.read_text(encoding="utf-8"))["lines"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise SettingsError(f"{file}: not a saved benchmark") from error


def ratios_of(records: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Return the ratio of each line of a benchmark, by name."""
    ratios = {str(record["name"]): float(record["ratio_to_calibration"]) for record in records}
    if not all(ratio > 0.0 for ratio in ratios.values()):
        raise ValueError("a ratio is not positive")
    return ratios


def changes(before: Mapping[str, float], now: Mapping[str, float]) -> list[Change]:
    """Return how each figure that both have has changed, the worst first."""
    both = [Change(name, now[name] / before[name]) for name in now if name in before]
    return sorted(both, key=lambda change: -change.factor)


def comparison_text(before: Mapping[str, float], now: Mapping[str, float]) -> str:
    """Return what got slower, one line each, and what only one of the two has."""
    lines = [
        f"slower: {change.name}, {change.factor:.2f} times what it was"
        for change in changes(before, now)
        if change.factor > SLOWER
    ]
    if not lines:
        lines = [f"nothing is slower by more than {SLOWER:g} times"]
    lines += [f"new: {name}" for name in now if name not in before]
    lines += [f"gone: {name}" for name in before if name not in now]
    return "\n".join(lines)


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


if __name__ == "__main__":
    sys.exit(main())
