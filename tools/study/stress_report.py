"""Write the report of a stress study again, from its stored results."""

import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from steer_by_wire.runtime.command_line import command_parser
from steer_by_wire.runtime.program.program import ExitStatus, run_main

NAME = "steer-by-wire stress-report"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    parser = command_parser(
        NAME,
        __doc__,
        f"steer-by-wire stress latency_jitter\n{NAME} out/stress/latency_jitter",
        "FOLDER [options]",
    )
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="folder with a study's results")
    return run_main(NAME, partial(_run, parser.parse_args(arguments).folder))


def _run(folder: Path) -> int:
    # Pictures and compiled runs take a second to import, which --help need not wait for.
    from steer_by_wire.tools.study.report import write

    print(f"report: {write(folder)}")
    return ExitStatus.OK


if __name__ == "__main__":
    sys.exit(main())
