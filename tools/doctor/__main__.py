"""Check what this machine has for CAN and real time, and advise how to get what it lacks.

    steer-by-wire doctor [--json FILE]
    steer-by-wire doctor --measure [--duration SECONDS]

``--measure`` measures which control rate the machine keeps: as an ordinary program, and with the
real-time rights that the host grants. docs/real_time.md explains how to read the result.

Exit status 0 whatever it finds: a machine without CAN is no mistake.
"""

import argparse
import sys
from collections.abc import Sequence
from functools import partial
from typing import Any

from steer_by_wire.runtime.command_line import add_json_argument, command_parser, run_main, seconds
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.program.node_options import add_real_time_arguments
from steer_by_wire.runtime.program.report import show_or_write
from steer_by_wire.tools.doctor import checks

NAME = "steer-by-wire doctor"


def main(arguments: Sequence[str] | None = None) -> int:
    """Examine or measure, and print; returns the exit status."""
    parser = command_parser(NAME, __doc__, f"{NAME} --measure --json figures.json")
    add_json_argument(parser)
    parser.add_argument("--measure", action="store_true", help="measure which rate it can keep")
    group = parser.add_argument_group("with --measure")
    group.add_argument(
        "--duration", type=seconds, default=1.0, metavar="SECONDS",
        help="duration of each measurement (default: %(default)g)",
    )  # fmt: skip
    add_real_time_arguments(parser)
    return run_main(NAME, partial(_run, parser.parse_args(arguments)))


def _run(options: argparse.Namespace) -> int:
    record: Any
    if options.measure:
        from steer_by_wire.tools.doctor import kept_rate  # needs rich, which may be missing

        measured = kept_rate.measure(options, NAME)
        record, show = kept_rate.record_of(*measured), partial(kept_rate.show, *measured)
    else:
        sections = checks.examine()
        record, show = checks.as_json(sections), partial(print, checks.as_text(sections))
    show_or_write(options.json, record, show)
    return ExitStatus.OK


if __name__ == "__main__":
    sys.exit(main())
