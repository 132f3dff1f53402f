"""Check what this machine has for CAN and real time, and advise how to get what it lacks.

    steer-by-wire doctor [--json FILE]

Exit status 0 whatever it finds: a machine without CAN is no mistake.
"""

import argparse
import sys
from collections.abc import Sequence
from functools import partial

from steer_by_wire.runtime.command_line import add_json_argument, command_parser, run_main
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.program.report import show_or_write
from steer_by_wire.tools.doctor import checks

NAME = "steer-by-wire doctor"


def main(arguments: Sequence[str] | None = None) -> int:
    """Examine and print; returns the exit status."""
    parser = command_parser(NAME, __doc__, f"{NAME} --json findings.json")
    add_json_argument(parser)
    return run_main(NAME, partial(_run, parser.parse_args(arguments)))


def _run(options: argparse.Namespace) -> int:
    found = checks.examine()
    show_or_write(options.json, checks.as_json(found), partial(print, checks.as_text(found)))
    return ExitStatus.OK


if __name__ == "__main__":
    sys.exit(main())
