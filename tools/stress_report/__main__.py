"""Write the report of a stress study anew: ``steer-by-wire stress-report FOLDER``."""

import argparse
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from steer_by_wire.runtime.program import ExitStatus, run_main
from steer_by_wire.tools.stress_report import write_report

NAME = "stress_report"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    parser = argparse.ArgumentParser(
        prog="steer-by-wire stress-report",
        description=(__doc__ or "").splitlines()[0],
        allow_abbrev=False,
    )
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="with a study's results")
    return run_main(NAME, partial(_run, parser.parse_args(arguments).folder))


def _run(folder: Path) -> int:
    print(f"report: {write_report(folder)}")
    return ExitStatus.OK


if __name__ == "__main__":
    sys.exit(main())
