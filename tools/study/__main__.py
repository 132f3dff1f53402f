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
from functools import partial
from pathlib import Path

from steer_by_wire.runtime.command_line import command_parser, offer, run_main, whole_number
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.program.node_options import settings_file
from steer_by_wire.runtime.settings import preset_names

NAME = "steer-by-wire study"
SHIPPED = "steer_by_wire.closed_loop.studies"
FAULT_TIME = f"{SHIPPED}.fault_time"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    example = f"{NAME} latency_jitter --dry-run"
    parser = command_parser(NAME, __doc__, example, "[STUDY] [options]")
    shipped = [*preset_names(SHIPPED), *preset_names(FAULT_TIME)]
    study = parser.add_argument(
        "study", type=_study_file, nargs="?", metavar="STUDY",
        help=f"a file, or one of {', '.join(shipped)}",
    )  # fmt: skip
    offer(study, lambda: shipped)
    parser.add_argument("--list", action="store_true", help="print the shipped studies, and end")
    parser.add_argument(
        "--report", type=Path, metavar="DIR",
        help="write the report of stored results again, and end",
    )  # fmt: skip
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="folder for the results (default: out/study/NAME)"
    )
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


def _study_file(text: str) -> Path:
    """Return the file of a study, also of that of fault times."""
    package = FAULT_TIME if text in preset_names(FAULT_TIME) else SHIPPED
    return settings_file(package)(text)


def _run(options: argparse.Namespace) -> int:
    # What computes and draws takes seconds to import, which --help need not wait for.
    if options.list:
        read_study = importlib.import_module(f"{SHIPPED}.study_file").read_study
        for name in preset_names(SHIPPED):
            file = settings_file(SHIPPED)(name)
            print(f"{name:<18} {read_study(file).title}\n{'':<18} {file}")
        read = importlib.import_module(f"{FAULT_TIME}.settings").read_fault_time
        for name in preset_names(FAULT_TIME):
            file = settings_file(FAULT_TIME)(name)
            print(f"{name:<18} {read(file).title}\n{'':<18} {file}")
        return ExitStatus.OK
    if options.report is not None:
        write = importlib.import_module("steer_by_wire.tools.study.report").write
        print(f"report: {write(options.report)}")
        return ExitStatus.OK
    if importlib.import_module(f"{FAULT_TIME}.settings").is_fault_time(options.study):
        run = importlib.import_module("steer_by_wire.tools.study.fault_time").run_fault_time
        return int(run(options))
    run_study = importlib.import_module("steer_by_wire.tools.study.program").run_study
    return int(run_study(options))


if __name__ == "__main__":
    sys.exit(main())
