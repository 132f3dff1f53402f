"""Bound the response times of messages on a CAN bus.

steer-by-wire can response-times FILE.dbc...
"""

import sys
from collections.abc import Sequence
from functools import partial

from steer_by_wire.runtime.command_line import add_subcommand, command_parser, run_main
from steer_by_wire.tools.can import response_times

NAME = "steer-by-wire can"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the subcommand; returns its exit status."""
    example, usage = response_times.EXAMPLE, response_times.USAGE
    parser = command_parser(NAME, __doc__, example, "response-times ...")
    parsers = parser.add_subparsers(
        prog=NAME, dest="subcommand", required=True, metavar="SUBCOMMAND"
    )
    added = add_subcommand(parsers, "response-times", response_times.__doc__, example, usage)
    response_times.add_arguments(added)
    options = parser.parse_args(arguments)
    return run_main(response_times.NAME, partial(response_times.run, options))


if __name__ == "__main__":
    sys.exit(main())
