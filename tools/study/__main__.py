"""Run a study: thousands of runs over latency, jitter, vehicles and laws, and their report.

    steer-by-wire study --list
    steer-by-wire study compare --dry-run
    steer-by-wire study STUDY [--out DIR] [--workers N]
    steer-by-wire study STUDY --replay ID
    steer-by-wire study --report DIR

Ctrl-C ends it and keeps the computed runs; the same command continues from there. The bytes of the
results do not depend on interruptions, threads or machines.
"""

import argparse
import importlib
import sys
from collections.abc import Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path

from steer_by_wire.runtime.command_line import (
    add_out_argument,
    command_parser,
    output_folder,
    run_main,
    whole_number,
)
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.program.node_options import settings_file
from steer_by_wire.runtime.settings import SettingsError, preset_names, read_table

NAME = "steer-by-wire study"
SHIPPED = "steer_by_wire.closed_loop.studies"
OWN_KINDS = ("fault_time", "vehicle_tests")
"""Studies that are no grid of runs: each has a room, and a module in this one."""
_study_file = settings_file(SHIPPED, *(f"{SHIPPED}.{kind}" for kind in OWN_KINDS))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    example = f"{NAME} latency_jitter --dry-run"
    parser = command_parser(NAME, __doc__, example, "[STUDY] [options]")
    parser.add_argument(
        "study", type=_study_file, nargs="?", metavar="STUDY",
        help=f"a file, or one of {', '.join(_shipped())}",
    )  # fmt: skip
    parser.add_argument("--list", action="store_true", help="print the shipped studies, and end")
    parser.add_argument(
        "--report", type=output_folder, metavar="DIR",
        help="write the report of stored results again, and end",
    )  # fmt: skip
    add_out_argument(parser, None, "folder for the results (default: out/study/NAME)")
    parser.add_argument(
        "--dry-run", action="store_true", help="print the size of the study, and end"
    )
    parser.add_argument("--no-report", action="store_true", help="write no report")
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--workers", type=whole_number(1, 4096), metavar="N",
        help="runs at once (default: one per processor)",
    )  # fmt: skip
    where.add_argument(
        "--scheduler", metavar="ADDRESS", help="scheduler of dask.distributed, for many machines"
    )
    parser.add_argument(
        "--replay",
        type=int,
        metavar="ID",
        help="write the settings of one run, and print the commands that run it again",
    )
    options = parser.parse_args(arguments)
    if (options.study is not None) + options.list + (options.report is not None) != 1:
        parser.error("give one of STUDY, --list and --report DIR")
    return run_main(NAME, partial(_run, options))


def _shipped() -> list[str]:
    return [*preset_names(SHIPPED), *OWN_KINDS]


def _own_kind(file: Path) -> str | None:
    """Return the kind of a study by its first table; other mistakes are for its reader to tell."""
    for kind in OWN_KINDS:
        with suppress(SettingsError):
            read_table(file, kind)
            return kind
    return None


def _run(options: argparse.Namespace) -> int:
    # What computes and draws takes seconds to import, which --help need not wait for.
    if options.list:
        read_study = importlib.import_module(f"{SHIPPED}.study_file").read_study
        for name in _shipped():
            file = _study_file(name)
            is_own = name in OWN_KINDS
            title = read_table(file, name)["title"] if is_own else read_study(file).title
            print(f"{name:<18} {title}\n{'':<18} {file}")
        return ExitStatus.OK
    if options.report is not None:
        write = importlib.import_module("steer_by_wire.tools.study.report").write
        print(f"report: {write(options.report)[0]}")
        return ExitStatus.OK
    if kind := _own_kind(options.study):
        run = importlib.import_module("steer_by_wire.tools.study.own_kinds").run_own_kind
        return int(run(kind, options))
    run_study = importlib.import_module("steer_by_wire.tools.study.program").run_study
    return int(run_study(options))


if __name__ == "__main__":
    sys.exit(main())
