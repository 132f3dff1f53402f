"""Check what this machine has for CAN and real time, and advise how to get what it lacks.

    steer-by-wire doctor [--json FILE]
    steer-by-wire doctor --measure [-i INTERFACE -c CHANNEL] [--duration SECONDS]

``--measure`` measures how punctual the machine is, how fast its bus is, and which rate it can keep:
as an ordinary program, and with the real-time rights that the host grants. Without ``-i`` the bus
is chosen as the programs choose it; if that is the emulated bus and none is running, the doctor
starts its own. On the bus it sends only its own requests and echoes, 0x7FE and 0x7FF, a hundred a
second each. docs/real_time.md explains how to read the result.

Exit status 0 whatever it finds: a machine without CAN is no mistake.
"""

import argparse
import sys
from collections.abc import Sequence
from functools import partial
from typing import Any

from steer_by_wire.runtime.command_line import add_json_argument, command_parser, run_main, seconds
from steer_by_wire.runtime.exit_status import ExitStatus
from steer_by_wire.runtime.port.interface_choice import add_bus_arguments
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
    group.add_argument(
        "--no-fast-socketcan", dest="fast_socketcan", action="store_false",
        help="use python-can for SocketCAN too",
    )  # fmt: skip
    add_real_time_arguments(parser)
    add_bus_arguments(parser)
    return run_main(NAME, partial(_run, parser.parse_args(arguments)))


def _run(options: argparse.Namespace) -> int:
    record: Any
    if options.measure:
        from steer_by_wire.tools.doctor import measurement_report  # needs rich, which may lack

        measured = measurement_report.measure_with_progress(options, NAME)
        record = measurement_report.record_of(measured)
        show = partial(measurement_report.show, measured)
    else:
        sections = checks.examine()
        record, show = checks.as_json(sections), partial(print, checks.as_text(sections))
    show_or_write(options.json, record, show)
    return ExitStatus.OK


if __name__ == "__main__":
    sys.exit(main())
